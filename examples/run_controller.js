// Runs a controller of the repertoire in plain JavaScript, from the response of get_behavior alone.
//
//   node examples/run_controller.js response.json < observations.txt > actions.txt
//
// response.json is the response of pga_me_msgs/srv/GetBehavior as JSON, as rosbridge sends it and examples/save_response.py
// saves it. Each line of input has the entries of one observation, in order; joint positions in rad, everything else in the
// units that the message names. Each line of output has the entries of one action.
"use strict";
const fs = require("fs");

class Controller {
  constructor(message) {
    this.message = message;
    // Each layer is (out, in) weights row by row, then (out) biases.
    this.layers = [];
    let next = 0;
    for (let i = 1; i < message.layer_sizes.length; i++) {
      const [inputs, outputs] = [message.layer_sizes[i - 1], message.layer_sizes[i]];
      const weight = message.parameters.slice(next, next + outputs * inputs);
      const bias = message.parameters.slice(next + outputs * inputs, next + outputs * (inputs + 1));
      next += outputs * (inputs + 1);
      this.layers.push({ inputs, outputs, weight, bias, activation: message.activations[i - 1] });
    }
    if (next !== message.parameters.length) throw new Error("parameters do not fit layer_sizes");
    // Which entry has the position of which joint.
    this.joints = message.joint_names.map((name) => message.observation_names.indexOf(`${name}/position`));
  }

  // What the network sees: joints from -1 at the lower limit to +1 at the upper one, every entry within its limits.
  observation(measured) {
    const { joint_low: low, joint_high: high, observation_low: least, observation_high: most } = this.message;
    const seen = Array.from(measured);
    this.joints.forEach((entry, j) => { seen[entry] = (2 * (seen[entry] - low[j])) / (high[j] - low[j]) - 1; });
    return least.length ? seen.map((x, i) => Math.min(Math.max(x, least[i]), most[i])) : seen;
  }

  // Action for what was measured.
  act(measured) {
    let x = this.observation(measured);
    if (x.length !== this.layers[0].inputs || !x.every(Number.isFinite)) {
      throw new Error(`expected ${this.layers[0].inputs} numbers: ${this.message.observation_names.join(", ")}`);
    }
    for (const { inputs, outputs, weight, bias, activation } of this.layers) {
      const sums = [];
      for (let row = 0; row < outputs; row++) {
        let sum = bias[row];
        for (let i = 0; i < inputs; i++) sum += weight[row * inputs + i] * x[i];
        sums.push(activation === "relu" ? Math.max(sum, 0) : Math.tanh(sum));
      }
      x = sums;
    }
    return x;
  }
}

const response = JSON.parse(fs.readFileSync(process.argv[2], "utf8"));
if (!response.found) throw new Error(response.message);
const controller = new Controller(response.controller);
for (const line of fs.readFileSync(0, "utf8").split("\n")) {
  if (line.trim()) console.log(controller.act(line.trim().split(/\s+/).map(Number)).join(" "));
}
