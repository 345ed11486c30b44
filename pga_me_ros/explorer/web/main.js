"use strict";
// Puts the page together.
const Explorer = (() => {
  function summary() {
    const { runs } = Store.state;
    const words = runs.map((run) => {
      const { evaluations } = run.curves;
      const done = evaluations.length ? `, ${Numbers.text(evaluations[evaluations.length - 1])} evaluations` : "";
      const missing = run.archive.cells - run.elites.length;
      return `${run.caption}: ${run.run.algorithm}, seed ${run.run.seed}${done}, ${run.elites.length} gaits, ${missing} cells empty${run.run.note ? `; ${run.run.note}` : ""}`;
    });
    Page.byId("summary").textContent = words.join(" · ");
  }

  // Names that tell the runs apart.
  function caption(run, runs) {
    const alone = runs.every((other) => other === run || other.run.name !== run.run.name);
    return alone ? run.run.name : `${run.run.name} (${run.run.run_id.slice(0, 8)})`;
  }

  function show(contents) {
    const runs = contents.map((content, i) => Store.read(content, i));
    for (const run of runs) run.caption = caption(run, runs);
    document.querySelector("main").classList.toggle("two", runs.length > 1);
    return runs;
  }

  // A cell that is empty, or of no run, is not chosen; the best gait is.
  function sound(changes, runs) {
    const run = runs[changes.run] ? changes.run : 0;
    const cell = changes.cell;
    const found = runs[run].byCell.has(cell);
    const elite = found ? runs[run].byCell.get(cell) : Store.best(runs[run]);
    const color = Colors.MEASURES[changes.color] ? changes.color : Store.state.color;
    const { starts, simulates } = runs[run];
    if (simulates && /^(unseen:\d+|randomized:\d+:.+|damaged:\d+:[^:]*:.+)$/.test(changes.start) && !starts.includes(changes.start)) starts.push(changes.start);
    const start = starts.includes(changes.start) ? changes.start : starts[0];
    const layout = Layouts.choices(runs[run]).some(([name]) => name === changes.layout) ? changes.layout : "cells";
    return { run, cell: elite ? elite.cell : null, color, start, layout };
  }

  // Says which gait of a link there is not, until another one is chosen.
  function tellMissing({ run, cell }) {
    const { runs } = Store.state;
    const there = cell === undefined || (runs[run] || runs[0]).byCell.has(cell);
    Page.warn("link", there ? "" : `Cell ${cell}, which the link names, holds no gait in this run; the best gait is shown instead.`);
  }

  function makeSelects() {
    const [color, layout] = [Page.byId("color"), Page.byId("layout")];
    Page.options(color, Object.entries(Colors.MEASURES).map(([key, { title }]) => [key, title]), Store.state.color);
    color.addEventListener("change", () => Store.set({ color: color.value }));
    const choices = Layouts.choices(Store.run());
    Page.options(layout, choices, Store.state.layout);
    layout.addEventListener("change", () => Store.set({ layout: layout.value }));
    Page.byId("layout-label").hidden = choices.length < 2;
    Store.on("color layout", () => {
      color.value = Store.state.color;
      layout.value = Store.state.layout;
    });
  }

  function theme(dark) {
    document.documentElement.dataset.theme = dark ? "dark" : "light";
    const button = Page.byId("theme");
    button.textContent = dark ? "Light" : "Dark";
    button.setAttribute("aria-label", `${button.textContent} colors`);
    button.onclick = () => theme(!dark);
    Stage.theme();
    Store.set({ dark });
  }

  function start() {
    const content = JSON.parse(Page.byId("content").textContent);
    Page.byId("title").textContent = content.title;
    const dark = matchMedia("(prefers-color-scheme: dark)");
    theme(dark.matches);
    dark.addEventListener("change", () => theme(dark.matches));
    for (const part of [Maps, Choice, Details, Curves, Player]) part.start();
    if (content.runs.length) open(content.runs);
    if (content.live) Live.start(content);
    Store.on("run cell", () => Page.warn("link", ""));
    Address.follow((changes) => {
      Store.set(sound(changes, Store.state.runs));
      tellMissing(changes);
    });
  }

  // Shows runs for the first time.
  function open(contents) {
    const runs = show(contents);
    const asked = Address.read();
    const first = sound(asked, runs);
    Store.set({ runs, layout: first.layout, run: first.run });
    makeSelects();
    Player.drawStarts();
    Store.on("run cell color layout start", Address.write);
    Store.on("runs", summary);
    summary();
    Store.set(first);
    tellMissing(asked);
    Player.load();
  }

  // Takes what has changed of a run; the gait that is watched goes on unless another has taken its cell. What failed, as
  // of a gait that was replaced meanwhile, is tried again.
  function update(index, content) {
    const before = Store.chosen();
    const runs = Store.state.runs.map((run, i) => (i === index ? Store.read({ ...run, ...content }, i) : run));
    for (const run of runs) run.caption = caption(run, runs);
    Store.set({ runs });
    const after = Store.chosen();
    if (!after) Store.set({ cell: Store.best(Store.run()).cell });
    else if (!before || after.evaluation !== before.evaluation || Player.failed()) Player.load();
  }

  return { start, open, show, update, view: Player.view, seek: Player.seek, play: Player.play, state: Store.state };
})();
window.Explorer = Explorer;
Explorer.start();
