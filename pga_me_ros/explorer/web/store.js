"use strict";
// What is shown and what is chosen. Parts of the page register with on() and are told what changed.
const Store = (() => {
  const state = { runs: [], run: 0, cell: null, color: "fitness", layout: "", start: "evaluation", matching: null, dark: false };
  const listeners = [];

  function on(names, act) {
    listeners.push({ names: names.split(" "), act });
  }

  // Changes entries of the state and tells each listener of them once.
  function set(changes) {
    const changed = Object.keys(changes).filter((name) => changes[name] !== state[name]);
    Object.assign(state, changes);
    for (const { names, act } of listeners) if (names.some((name) => changed.includes(name))) act(state);
  }

  // Columns of numbers, as they come, to one object per elite.
  function elites(columns) {
    const names = Object.keys(columns);
    return columns.cell.map((_, i) => {
      const elite = Object.fromEntries(names.map((name) => [name, columns[name][i]]));
      elite.judged = elite.repeats > 0;
      elite.promise = elite.judged ? elite.mean_fitness : elite.fitness;
      elite.promised = elite.judged ? elite.mean_descriptor : elite.descriptor;
      return elite;
    });
  }

  // Returns a run as it came, with its elites as objects, and found by cell and by evaluation.
  function read(content, index) {
    const rows = elites(content.elites);
    return {
      ...content,
      index,
      elites: rows,
      byCell: new Map(rows.map((e) => [e.cell, e])),
      byEvaluation: new Map(rows.map((e) => [e.evaluation, e])),
    };
  }

  const run = () => state.runs[state.run];
  const chosen = () => (run() && state.cell !== null ? run().byCell.get(state.cell) : undefined);
  const best = (of) => of.elites.reduce((a, b) => (b.promise > a.promise ? b : a), of.elites[0]);
  // Why two runs cannot be compared cell by cell; empty if they can.
  function unlike() {
    const differ = (part) => JSON.stringify(part(state.runs[0])) !== JSON.stringify(part(state.runs[1]));
    if (differ((r) => r.spec.name)) return "the two runs are of different tasks";
    if (differ((r) => r.spec.descriptor_names)) return "the descriptors of the two runs are not the same";
    return differ((r) => r.archive) ? "the cells of the two runs are not the same" : "";
  }

  const comparable = () => state.runs.length === 2 && !unlike();

  return { state, on, set, read, run, chosen, best, unlike, comparable };
})();

// The address of the page names the gait that is shown, so that a link opens it again.
const Address = (() => {
  const NAMES = ["run", "cell", "color", "layout", "start"];
  let own = "";

  function read() {
    const given = new URLSearchParams(location.hash.slice(1));
    const changes = {};
    for (const name of NAMES) {
      if (!given.has(name)) continue;
      const text = given.get(name);
      changes[name] = name === "run" || name === "cell" ? Number(text) : text;
    }
    return changes;
  }

  function write(state) {
    const words = new URLSearchParams();
    for (const name of NAMES) if (state[name] !== null && state[name] !== "") words.set(name, state[name]);
    own = `#${words}`;
    if (location.hash !== own) location.replace(own);
  }

  function follow(act) {
    window.addEventListener("hashchange", () => {
      if (location.hash !== own) act(read());
    });
  }

  return { read, write, follow };
})();
