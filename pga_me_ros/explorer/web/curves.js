"use strict";
// How the run went: its curves, what its operators contributed, and its figures by re-evaluations.
const Curves = (() => {
  const [WIDTH, HEIGHT, LEFT, BOTTOM, TOP] = [320, 190, 52, 32, 8];
  const LINES = [["qd_score", "QD-score (sum of fitness)"], ["coverage", "coverage (filled cells)"], ["max_fitness", "best fitness"]];
  const COLORS = ["var(--accent)", "var(--focus)"];

  function figure(key, title, runs) {
    const xs = runs.map((run) => run.curves.evaluations);
    const ys = runs.map((run) => run.curves[key]);
    const dots = runs.map((run) => run.measured.map((m) => [xs[run.index][m.generation], m[key]]).filter((p) => p[0] !== undefined && p[1] !== null));
    const most = Math.max(1, ...xs.map((line) => line[line.length - 1] || 0));
    const [low, high] = Numbers.range([...ys.flat(), ...dots.flat().map((p) => p[1]), 0]);
    const x = (u) => LEFT + (u / most) * (WIDTH - LEFT - 10);
    const y = (v) => TOP + (1 - (v - low) / (high - low || 1)) * (HEIGHT - TOP - BOTTOM);
    const text = (tx, ty, words, anchor) => Page.svg("text", { x: tx, y: ty, "text-anchor": anchor }, words);
    const lines = ys.map((line, i) => {
      const points = line.map((v, k) => (v === null ? null : `${x(xs[i][k]).toFixed(1)},${y(v).toFixed(1)}`)).filter(Boolean);
      return Page.svg("path", { d: points.length ? `M${points.join("L")}` : "", stroke: COLORS[i % 2] });
    });
    const marks = dots.flatMap((points, i) => points.map((p) => Page.svg("circle", { cx: x(p[0]), cy: y(p[1]), r: 4.5, fill: "none", stroke: COLORS[i % 2], "stroke-width": 2 })));
    const svg = Page.svg(
      "svg",
      { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, role: "img", "aria-label": `${title} over evaluations` },
      Page.svg("path", { d: `M${LEFT},${TOP}V${HEIGHT - BOTTOM}H${WIDTH - 10}`, stroke: "var(--line)" }),
      ...lines,
      ...marks,
      text(LEFT - 5, y(high) + 10, Numbers.text(high), "end"),
      text(LEFT - 5, y(low), Numbers.text(low), "end"),
      text(WIDTH - 10, HEIGHT - BOTTOM + 15, `${Numbers.text(most)} evaluations`, "end"),
    );
    const more = dots.some((points) => points.length) ? "; circle: corrected by re-evaluations" : "";
    return Page.make("figure", {}, svg, Page.make("figcaption", {}, title + more));
  }

  function table(caption, head, rows) {
    return Page.make(
      "div",
      { class: "scroll" },
      Page.make(
        "table",
        {},
        Page.make("caption", { class: "hint" }, caption),
        Page.make("thead", {}, Page.make("tr", {}, ...head.map((h) => Page.make("th", { scope: "col" }, h)))),
        Page.make("tbody", {}, ...rows.map((row) => Page.make("tr", {}, ...row.map((cell) => Page.make("td", {}, cell))))),
      ),
    );
  }

  function contributions(run) {
    const rows = run.contributions.map((c) => [
      run.operators[c.operator] || c.operator,
      ...["offspring", "new_elites", "improved_elites"].map((key) => Numbers.text(c[key])),
      Numbers.percent((c.new_elites + c.improved_elites) / c.offspring),
    ]);
    return table(`What each operator contributed${of(run)} in ${run.curves.generation.length} stored generation${run.curves.generation.length === 1 ? "" : "s"}`, ["operator", "offspring", "new cells", "improved", "entered"], rows);
  }

  const of = (run, word = "to") => (Store.state.runs.length > 1 ? ` ${word} ${run.caption}` : "");

  const CORRECTED = [
    ["elites", "re-evaluated elites"], ["repeats", "re-evaluations of each, at least"], ["coverage", "corrected coverage"], ["qd_score", "corrected QD-score"],
    ["max_fitness", "best mean fitness"], ["mean_fitness", "mean fitness"], ["fitness_difference", "luck in the fitness when found"],
    ["fitness_spread", "spread of fitness"], ["descriptor_error", "distance from descriptor to its mean"], ["fall_share", "share of falls"],
  ];

  function corrected(run) {
    if (!run.corrected) {
      const how = run.served ? "a run does that at its end, or ros2 run pga_me_ros reevaluate RUN_DIR later" : `ros2 run pga_me_ros reevaluate ${Commands.word(run.run.name)}`;
      return Page.make("p", { class: "hint" }, `Not all gaits${of(run, "of")} were re-evaluated: ${how}.`);
    }
    const rows = CORRECTED.map(([key, title]) => [title, key === "fall_share" ? Numbers.percent(run.corrected[key]) : Numbers.text(run.corrected[key])]);
    return table(`What the gaits${of(run, "of")} are worth on average`, ["measure", "value"], rows);
  }

  function draw() {
    const { runs } = Store.state;
    const long = runs.some((run) => run.curves.evaluations.length > 1);
    const key = Page.make("p", { class: "hint key" }, ...runs.map((run, i) => Colors.swatch(COLORS[i % 2], run.caption)));
    Page.replace(Page.byId("curves"), long && runs.length > 1 ? key : null, ...(long ? LINES.map(([key, title]) => figure(key, title, runs)) : []));
    Page.replace(Page.byId("facts"), ...runs.map(contributions), ...runs.map(corrected));
  }

  function start() {
    Store.on("runs", draw);
  }

  return { start };
})();
