"use strict";
// Commands that fetch a gait from a served repertoire, or run it.
const Commands = {
  // The namespace of a graph; that of a stored run is the one in which the user serves it.
  at: (run) => (run.run.namespace || "").replace(/^\/$/, ""),

  service: (run, elite) =>
    `ros2 service call ${Commands.at(run)}/repertoire/get_behavior pga_me_msgs/srv/GetBehavior "{select: 1, cell: ${elite.cell}}"`,

  python: (run, elite) =>
    [
      "import rclpy",
      "from pga_me_ros.client import RepertoireClient",
      "",
      "rclpy.init()",
      'node = rclpy.create_node("robot")',
      `behavior = RepertoireClient(node${Commands.at(run) && `, "${Commands.at(run)}"`}).get_behavior(cell=${elite.cell})`,
      "print(behavior.promised_fitness, behavior.promised_descriptor)",
      "action = behavior.controller(observation)  # every behavior.controller.control_period seconds",
    ].join("\n"),

  server: (run) => `ros2 run pga_me_ros archive_manager --ros-args -p ${Commands.word(`repertoire:=${Commands.yaml(run.run.name)}`)}`,

  // What stands in the filter, as a request; without a descriptor it is a list, which has 100 entries unless it says more.
  nearest(run, limits, found) {
    const parts = [];
    if (!limits.descriptor && found > 100) parts.push(`limit: ${Math.min(found, 10_000)}`);
    if (limits.fitness !== null) parts.push(`min_fitness: ${Numbers.exact([limits.fitness]).slice(1, -1)}`);
    if (limits.falls !== null) parts.push(`max_fall_share: ${Numbers.exact([limits.falls]).slice(1, -1)}`);
    if (!limits.descriptor) return `ros2 service call ${Commands.at(run)}/repertoire/list_behaviors pga_me_msgs/srv/ListBehaviors "{${parts.join(", ")}}"`;
    parts.unshift(`descriptor: ${Numbers.exact(limits.descriptor)}`, `count: ${limits.count}`, "with_controllers: false");
    return `ros2 service call ${Commands.at(run)}/repertoire/get_behaviors pga_me_msgs/srv/GetBehaviors "{${parts.join(", ")}}"`;
  },

  export: (run, elite, kind) =>
    `ros2 run pga_me_ros export ${Commands.word(run.run.name)} --to ${kind} --cell ${elite.cell}`,

  // A text as a ROS parameter, which is YAML: in quotes where it would mean something else.
  yaml: (text) => (/^[A-Za-z_/][\w./-]*$/.test(text) && !/^(y|n|yes|no|on|off|true|false|null)$/i.test(text) ? text : JSON.stringify(text)),

  word: (text) => (/^[\w@%+=:,./-]+$/.test(text) ? text : `'${text.replaceAll("'", "'\\''")}'`),
};

// All that is known of the chosen gait.
const Details = (() => {
  const FORMATS = ["onnx", "npz", "torchscript"];

  function parent(run, evaluation) {
    const elite = run.byEvaluation.get(evaluation);
    if (!elite) return `evaluation ${evaluation} (replaced since)`;
    return Page.make("button", { type: "button", onclick: () => Store.set({ cell: elite.cell }) }, `cell ${elite.cell}`);
  }

  function rows(run, elite) {
    const names = run.spec.descriptor_names.join(", ");
    const list = [
      ["cell", String(elite.cell)],
      ["descriptor", `${names}: ${Numbers.list(elite.descriptor)} when found`],
      ["when found", `fitness ${Numbers.text(elite.fitness)} in ${Numbers.text(elite.steps * run.spec.control_period)} s${elite.terminated ? ", then fell" : ""}`],
    ];
    if (elite.judged) {
      const spread = elite.fitness_spread === null ? "" : ` ± ${Numbers.text(elite.fitness_spread)}`;
      const where = elite.mean_cell === elite.cell ? "the same cell" : `cell ${elite.mean_cell}`;
      list.push(
        ["on average", `fitness ${Numbers.text(elite.mean_fitness)}${spread} in ${elite.repeats} re-evaluations`],
        ["luck", `${Numbers.text(elite.fitness - elite.mean_fitness)} of the fitness when found`],
        ["falls", Numbers.percent(elite.fall_share)],
        ["mean descriptor", `${Numbers.list(elite.mean_descriptor)}, in ${where}`],
      );
    } else {
      list.push(["on average", "unknown: not re-evaluated"]);
    }
    const parents = elite.parents.length ? elite.parents.flatMap((p, i) => (i ? [" and ", parent(run, p)] : [parent(run, p)])) : ["no parents"];
    list.push(["lineage", [`evaluation ${elite.evaluation}, generation ${elite.generation}, by ${run.operators[elite.made_by] || elite.made_by}, from `, ...parents]]);
    return list;
  }

  const button = (id, title, text) => Page.make("button", { type: "button", id, onclick: () => Page.copy(text(), "actions") }, title);

  let told = "";

  function draw() {
    const run = Store.run();
    const elite = Store.chosen();
    const now = JSON.stringify([run.caption, Store.state.cell, elite, elite && elite.parents.map((p) => (run.byEvaluation.get(p) || {}).cell)]);
    if (now === told) return; // a run that grows must not take the focus from a button
    told = now;
    if (!elite) {
      Page.replace(Page.byId("figures"), Page.make("dt", {}, Store.state.cell === null ? "Choose a cell." : `Cell ${Store.state.cell} is empty.`));
      Page.replace(Page.byId("actions"));
      return;
    }
    Page.byId("copied").textContent = "";
    const many = Store.state.runs.length > 1 ? [["run", run.caption]] : [];
    Page.replace(
      Page.byId("figures"),
      ...[...many, ...rows(run, elite)].flatMap(([term, text]) => [Page.make("dt", {}, term), Page.make("dd", {}, ...[text].flat())]),
    );
    Page.replace(
      Page.byId("actions"),
      button("copy-service", "Copy as ros2 service call", () => Commands.service(run, elite)),
      button("copy-python", "Copy as Python", () => Commands.python(run, elite)),
      run.served ? null : button("copy-server", "Copy: serve this repertoire", () => Commands.server(run)),
      button("copy-link", "Copy link to this gait", () => location.href),
      ...FORMATS.map((kind) =>
        run.simulates
          ? Page.make("button", { type: "button", id: `download-${kind}`, onclick: () => Live.download(run, elite, kind) }, `Download ${kind}`)
          : button(`copy-${kind}`, `Copy: export as ${kind}`, () => Commands.export(run, elite, kind)),
      ),
    );
  }

  function start() {
    Store.on("runs run cell", draw);
  }

  return { start };
})();
