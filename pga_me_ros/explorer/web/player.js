"use strict";
// Plays the chosen gait, and those that are kept beside it, in step.
const Player = (() => {
  const MOST = 4;
  const SPEEDS = ["0.1", "0.25", "0.5", "1", "2", "4"];
  let lanes = []; // {run, cell, start, motion}, the chosen one first
  let pinned = []; // {run, cell, start} that stay
  let time = 0;
  let playing = false;
  let last = null;
  let ready = false;
  let asked = 0;
  let failed = false; // whether the stage is empty because a motion did not come

  const end = () => Math.max(0, ...lanes.map((lane) => lane.motion.end));
  const same = (a, b) => a.run === b.run && a.cell === b.cell && a.start === b.start;

  function say(text) {
    const place = Page.byId("no-stage");
    place.hidden = !text;
    place.textContent = text;
  }

  // Loads the chosen gait and its companions; an answer that comes late, after another choice, is not shown.
  async function load() {
    const turn = (asked += 1);
    const elite = Store.chosen();
    if (!elite || !ready) return;
    const chosen = { run: Store.state.run, cell: elite.cell, start: Store.state.start };
    const wanted = [chosen, ...pinned.filter((lane) => !same(lane, chosen))].slice(0, MOST);
    const run = Store.run();
    if (run.simulates && run.model) Page.byId("readings").textContent = `Simulating cell ${elite.cell} …`;
    const sought = wanted.map((lane) => ({ ...lane, run: Store.state.runs[lane.run] }));
    Motions.giveUpAllBut(sought);
    try {
      const motions = await Promise.all(sought.map((lane) => Motions.find(lane.run, lane.cell, lane.start)));
      if (turn !== asked) return;
      failed = false;
      lanes = wanted.map((lane, i) => ({ ...lane, motion: motions[i] }));
      const models = lanes.map((lane) => Store.state.runs[lane.run].model);
      Stage.show(lanes.map(({ motion }, i) => ({ model: models[i], lost: motion.lost })));
      say([...new Set(models.map((model) => model.note))].join(" ").trim());
    } catch (error) {
      if (turn !== asked) return;
      failed = true;
      lanes = [];
      Stage.show([]);
      say(error.message);
    }
    time = 0;
    const slider = Page.byId("time");
    slider.max = end();
    slider.disabled = Page.byId("play").disabled = !lanes.length;
    drawLanes();
    Strip.prepare(lanes[0], end());
    seek(0);
    play(lanes.length > 0 && !matchMedia("(prefers-reduced-motion: reduce)").matches);
  }

  function seek(moment) {
    time = Math.min(end(), Math.max(0, moment));
    Page.byId("time").value = time;
    Stage.pose(lanes.map((lane) => Motion.at(lane.motion, time)));
    readings();
    Strip.draw(time);
  }

  // Draws again in other colors, or in another width.
  function redraw() {
    if (!lanes.length) return;
    Strip.prepare(lanes[0], end());
    Strip.draw(time);
  }

  function readings() {
    const place = Page.byId("readings");
    if (!lanes.length) {
      place.textContent = "";
      return;
    }
    const { motion } = lanes[0];
    const { distance, speed } = Motion.progress(motion, Math.min(time, motion.end));
    const outcome = `fitness ${Numbers.text(motion.fitness)}${motion.fell ? `, falls at ${motion.length.toFixed(2)} s` : ""}${motion.kept === false ? ", differs from the stored evaluation: other library versions" : ""}`;
    place.textContent = `${time.toFixed(2)} of ${end().toFixed(2)} s · ${distance.toFixed(2)} m · ${speed.toFixed(2)} m/s · ${outcome}`;
  }

  function play(on) {
    playing = on;
    last = null;
    const button = Page.byId("play");
    button.textContent = on ? "Pause" : "Play";
    button.setAttribute("aria-label", button.textContent);
    if (on) requestAnimationFrame(step);
  }

  function step(now) {
    if (!playing) return;
    const speed = Number(Page.byId("speed").value);
    const gone = last === null ? 0 : Math.min(0.25, (now - last) / 1000);
    last = now;
    seek(time + speed * gone);
    if (time >= end()) play(false);
    else requestAnimationFrame(step);
  }

  const name = (lane) => `${Store.state.runs.length > 1 ? `${Store.state.runs[lane.run].caption}, ` : ""}cell ${lane.cell} (${startTitle(lane.start)})`;

  function drawLanes() {
    const chosen = lanes[0];
    const keep = chosen && pinned.length < MOST - 1 && !pinned.some((lane) => same(lane, chosen));
    const several = lanes.length > 1;
    const numbered = (lane) => (several ? `${1 + lanes.findIndex((other) => same(other, lane))}: ` : "") + name(lane);
    const kept = pinned.map((lane) =>
      Page.make("button", { type: "button", onclick: () => unpin(lane), "aria-label": `Remove ${numbered(lane)}` }, `✕ ${numbered(lane)}`),
    );
    Page.replace(
      Page.byId("lanes"),
      several && !pinned.some((lane) => same(lane, chosen)) ? Page.make("span", {}, numbered(chosen)) : null,
      keep ? Page.make("button", { type: "button", id: "pin", onclick: pin }, "Keep for comparison") : null,
      ...kept,
    );
  }

  function pin() {
    const { run, cell, start } = lanes[0];
    pinned.push({ run, cell, start });
    drawLanes();
  }

  function unpin(lane) {
    pinned = pinned.filter((other) => other !== lane);
    load();
  }

  function startTitle(key) {
    const [kind, seed] = key.split(":");
    if (kind === "evaluation") return "start of its evaluation";
    if (kind === "unseen") return `unseen start, seed ${seed}`;
    const rest = key.slice(`${kind}:${seed}:`.length);
    if (kind === "randomized") return `randomized, seed ${seed}: ${rest}`;
    const [, ranges, damage] = /^([^:]*):(.+)$/.exec(rest);
    return `damaged, seed ${seed}: ${damage}${ranges ? `; ${ranges}` : ""}`;
  }

  // Where the server simulates, any start may be asked for.
  function makeWorld() {
    const form = Page.byId("world");
    form.hidden = !Store.run().simulates || !Store.run().model;
    if (form.hidden || form.elements.length) return;
    const field = (name, title, attributes) => Page.make("label", {}, title, Page.make("input", { name, id: `world-${name}`, autocomplete: "off", ...attributes }));
    form.append(
      field("seed", "Seed of another start", { value: "2", inputmode: "numeric", pattern: "[0-9]+", required: true }),
      field("ranges", "Randomization (optional)", { class: "wide", placeholder: "mass 0.8 1.2, friction 0.6 1.2" }),
      field("damage", "Damage (optional)", { class: "wide", placeholder: "load 2, ice 0.25" }),
      Page.make("button", { type: "submit", id: "world-go" }, "Simulate"),
    );
    form.addEventListener("submit", (event) => {
      event.preventDefault();
      const seed = Number(form.elements.seed.value);
      const [ranges, damage] = [form.elements.ranges.value.trim(), form.elements.damage.value.trim()];
      form.elements.seed.value = seed + 1;
      setStart(damage ? `damaged:${seed}:${ranges}:${damage}` : ranges ? `randomized:${seed}:${ranges}` : `unseen:${seed}`);
    });
  }

  function setStart(key) {
    for (const run of Store.state.runs) if (!run.starts.includes(key)) run.starts.push(key);
    Store.set({ start: key });
    drawStarts();
  }

  function drawStarts() {
    makeWorld();
    const { starts } = Store.run();
    const chosen = starts.includes(Store.state.start) ? Store.state.start : starts[0];
    Page.options(Page.byId("start"), starts.map((key) => [key, startTitle(key)]), chosen);
    Store.set({ start: chosen });
  }

  function start() {
    const problem = Stage.open(Page.byId("stage"));
    ready = !problem;
    say(problem);
    Page.byId("play").addEventListener("click", () => {
      if (!playing && time >= end()) seek(0);
      play(!playing && lanes.length > 0);
    });
    Page.byId("time").addEventListener("input", (event) => {
      play(false);
      seek(Number(event.target.value));
    });
    Page.options(Page.byId("speed"), SPEEDS.map((s) => [s, `${s} ×`]), "1");
    Page.byId("start").addEventListener("change", (event) => Store.set({ start: event.target.value }));
    Strip.start((moment) => {
      play(false);
      seek(moment);
    });
    Store.on("run", drawStarts);
    Store.on("run cell start", load);
    Store.on("dark", redraw);
    window.addEventListener("resize", redraw);
  }

  const view = () => ({ time, end: end(), playing, cells: lanes.map((lane) => lane.cell), starts: lanes.map((lane) => lane.start), joints: lanes.length ? Stage.joints() : [] });
  return { start, load, failed: () => failed, seek, play, view, drawStarts };
})();

// What the descriptor is made of, over time: one row per entry, such as the contact of a foot.
const Strip = (() => {
  const ROW = 16;
  let picture = null; // the rows, drawn once per motion
  let end = 0; // seconds that the strip spans, as the slider does: those of the longest gait on the stage

  function prepare(lane, seconds) {
    end = seconds;
    const canvas = Page.byId("strip");
    const strip = lane && lane.motion.strip;
    canvas.hidden = !strip;
    picture = null;
    Page.byId("strip-names").textContent = !lane ? "" : strip ? `From top to bottom: ${strip.names.join(", ")}${strip.names.every((n) => n.includes("contact")) ? "; filled while it touches the ground" : ""}.` : "The task does not say what its descriptor is made of, so there is no strip chart.";
    if (!strip) return;
    const { rows, columns, values, low, high } = strip;
    canvas.width = Math.max(300, canvas.clientWidth);
    canvas.height = ROW * columns;
    picture = document.createElement("canvas");
    picture.width = canvas.width;
    picture.height = canvas.height;
    const context = picture.getContext("2d");
    const x = (i) => (lane.motion.seconds[i] / end) * canvas.width;
    for (let k = 0; k < columns; k += 1) {
      context.fillStyle = Page.color("empty");
      context.fillRect(0, k * ROW + 2, x(rows - 1), ROW - 4);
      context.fillStyle = Page.color("accent");
      for (let i = 0; i + 1 < rows; i += 1) {
        const value = values[i * columns + k];
        const full = high[k] > low[k] ? (value - low[k]) / (high[k] - low[k]) : Math.min(1, Math.max(0, value));
        context.globalAlpha = full;
        if (full > 0) context.fillRect(x(i), k * ROW + 2, x(i + 1) - x(i) + 0.6, ROW - 4);
      }
      context.globalAlpha = 1;
    }
  }

  function draw(time) {
    if (!picture) return;
    const canvas = Page.byId("strip");
    const context = canvas.getContext("2d");
    context.clearRect(0, 0, canvas.width, canvas.height);
    context.drawImage(picture, 0, 0);
    context.fillStyle = Page.color("focus");
    context.fillRect((time / end) * canvas.width - 1, 0, 2.5, canvas.height);
  }

  function start(seek) {
    const canvas = Page.byId("strip");
    canvas.addEventListener("click", (event) => {
      const { left, width } = canvas.getBoundingClientRect();
      seek(((event.clientX - left) / width) * Player.view().end);
    });
  }

  return { prepare, draw, start };
})();
