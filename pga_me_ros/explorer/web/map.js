"use strict";
// The map of a run: one shape per cell; it is pointed at, clicked, and walked through with the arrow keys.
const Maps = (() => {
  const WIDTH = 560;
  const LEFT = 76;
  const BOTTOM = 42;
  const EDGE = 8;
  const LINE = 20;
  let views = [];

  function facts(run, cell) {
    const elite = run.byCell.get(cell);
    if (!elite) return `cell ${cell}: empty`;
    const lines = [
      `cell ${cell}`,
      `descriptor ${Numbers.list(elite.promised)}${elite.judged ? " on average" : ""}`,
      `fitness ${Numbers.text(elite.fitness)} when found`,
    ];
    if (elite.judged) {
      const spread = elite.fitness_spread === null ? "" : ` ± ${Numbers.text(elite.fitness_spread)}`;
      lines.push(`mean of ${elite.repeats}: ${Numbers.text(elite.mean_fitness)}${spread}, falls ${Numbers.percent(elite.fall_share)}`);
    } else {
      lines.push("not re-evaluated");
    }
    lines.push(`${run.operators[elite.made_by] || elite.made_by}, generation ${elite.generation}, parents ${elite.parents.join(", ") || "none"}`);
    return lines.join("\n");
  }

  function tip(event, text) {
    const box = Page.byId("tip");
    box.hidden = !text;
    if (!text) return;
    box.textContent = text;
    const { width, height } = box.getBoundingClientRect();
    box.style.left = `${Math.max(4, Math.min(event.clientX + 14, innerWidth - width - 4))}px`;
    box.style.top = `${Math.max(4, Math.min(event.clientY + 14, innerHeight - height - 4))}px`;
  }

  const cellAt = (event) => {
    const cell = event.target.dataset && event.target.dataset.cell;
    return cell === undefined ? null : Number(cell);
  };

  // Draws one map. `compared` is the difference of two runs, which has its own colors.
  function draw(run, caption, compared) {
    const layout = Layouts.of(run, Store.state.layout, compared && Store.state.runs[1]);
    const height = (WIDTH - LEFT - EDGE) * layout.height;
    const x = (u) => LEFT + u * (WIDTH - LEFT - EDGE);
    const y = (v) => EDGE + (1 - v) * height;
    const middles = new Map();
    const shapes = new Map();
    // Borders between many bars would hide the bars.
    const group = Page.svg("g", { class: layout.bars && layout.shapes.length > 100 ? "narrow" : null });
    const tops = new Map();
    if (layout.background) group.append(Page.svg("rect", { class: "cell empty", x: x(0), y: y(1), width: x(1) - x(0), height }));
    for (const { cell, points, dot } of layout.shapes) {
      const shape = dot
        ? Page.svg("circle", { cx: x(dot[0]), cy: y(dot[1]), r: 5, "data-cell": cell })
        : Page.svg("path", { d: `M${points.map((p) => `${x(p[0]).toFixed(1)},${y(p[1]).toFixed(1)}`).join("L")}Z`, "data-cell": cell });
      const middle = dot || points.reduce((a, p) => [a[0] + p[0] / points.length, a[1] + p[1] / points.length], [0, 0]);
      middles.set(cell, middle);
      if (layout.bars) tops.set(cell, [x(middle[0]), y(points[2][1])]);
      shapes.set(cell, shape);
      group.append(shape);
    }
    for (const u of layout.lines ? layout.lines[0] : []) group.append(Page.svg("path", { class: "frame", d: `M${x(u)},${y(0)}V${y(1)}` }));
    for (const v of layout.lines ? layout.lines[1] : []) group.append(Page.svg("path", { class: "frame", d: `M${x(0)},${y(v)}H${x(1)}` }));
    const mark = Page.svg("path", { class: layout.bars ? "chosen bar" : "chosen" });
    const pointed = Page.svg("path", { class: "pointed" }); // on top: the neighbors would cover half of a cell's own border
    const label = (tx, ty, text, anchor, turned) =>
      Page.svg(
        "text",
        { x: tx, y: ty, "text-anchor": anchor, transform: turned ? `rotate(-90 ${tx} ${ty})` : null },
        ...text.split("\n").map((line, i) => Page.svg("tspan", { x: tx, dy: i ? LINE : 0 }, line)),
      );
    const below = BOTTOM + LINE * (layout.x.title.split("\n").length - 1);
    const svg = Page.svg(
      "svg",
      { viewBox: `0 0 ${WIDTH} ${height + EDGE + below}`, tabindex: 0, role: "application", "aria-label": `${caption}; arrow keys choose a cell` },
      group,
      Page.svg("rect", { class: "frame", x: x(0), y: y(1), width: x(1) - x(0), height }),
      mark,
      pointed,
      label(x(0), y(0) + 17, Numbers.text(layout.x.low), "start"),
      label(x(1), y(0) + 17, Numbers.text(layout.x.high), "end"),
      label((x(0) + x(1)) / 2, y(0) + 34, layout.x.title, "middle"),
      label(LEFT - 6, y(0), Numbers.text(layout.y.low), "end"),
      label(LEFT - 6, y(1) + 11, Numbers.text(layout.y.high), "end"),
      label(20, EDGE + height / 2, layout.y.title, "middle", true),
    );
    const view = { run, compared, middles, shapes, tops, mark, svg };
    svg.addEventListener("pointermove", (event) => {
      const cell = cellAt(event);
      tip(event, cell === null ? "" : compared ? gap(compared, cell) : facts(run, cell));
      pointed.setAttribute("d", event.target.classList.contains("elite") ? outline(event.target) : "");
    });
    svg.addEventListener("pointerleave", (event) => {
      tip(event, "");
      pointed.setAttribute("d", "");
    });
    svg.addEventListener("click", (event) => {
      const cell = cellAt(event);
      const owner = compared && cell !== null && !run.byCell.has(cell) ? Store.state.runs[1] : run;
      if (cell !== null && owner.byCell.has(cell)) Store.set({ run: owner.index, cell });
    });
    svg.addEventListener("keydown", (event) => walk(event, view));
    return { view, figure: Page.make("figure", {}, svg, Page.make("figcaption", {}, caption)) };
  }

  function gap(compared, cell) {
    if (compared.gaps.has(cell)) return `cell ${cell}: ${Numbers.text(compared.gaps.get(cell))}`;
    const [first, second] = Store.state.runs;
    const where = first.byCell.has(cell) ? "only in the first run" : second.byCell.has(cell) ? "only in the second run" : "empty";
    return `cell ${cell}: ${where}`;
  }

  const WAYS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };

  // Goes to the nearest elite that lies in the direction of the arrow rather than to its side.
  function walk(event, view) {
    const way = WAYS[event.key];
    if (!way) return;
    event.preventDefault();
    const { run, middles } = view;
    const here = Store.state.run === run.index ? middles.get(Store.state.cell) : undefined;
    const from = here || middles.get(Store.best(run).cell) || [0.5, 0.5];
    let least = Infinity;
    let found = here ? null : Store.best(run).cell;
    for (const [cell, [mx, my]] of here ? middles : []) {
      if (!run.byCell.has(cell) || cell === Store.state.cell) continue;
      const along = (mx - from[0]) * way[0] + (my - from[1]) * way[1];
      const aside = Math.abs((mx - from[0]) * way[1]) + Math.abs((my - from[1]) * way[0]);
      const bars = run.spec.descriptor_names.length === 1;
      if (along <= 1e-9 || (!bars && aside > 2 * along)) continue;
      const distance = along + (bars ? 0 : 2 * aside);
      if (distance < least) [least, found] = [distance, cell];
    }
    if (found !== null) Store.set({ run: run.index, cell: found });
  }

  function paint() {
    const { runs, color, matching, run: current } = Store.state;
    const scale = Colors.scale(color, runs);
    for (const { run, compared, shapes } of views) {
      for (const [cell, shape] of shapes) {
        const elite = run.byCell.get(cell) || (compared && Store.state.runs[1].byCell.get(cell));
        const out = elite && matching && run.index === current && !matching.has(cell);
        shape.setAttribute("class", elite ? `cell elite${out ? " out" : ""}` : "cell empty");
        if (elite) shape.style.fill = compared ? compared.color(cell) : scale.color(elite) || "var(--soft)";
        else shape.style.fill = "";
      }
    }
    Colors.legend(Page.byId("legend"), color, runs, Store.comparable());
  }

  function markChosen() {
    for (const { run, compared, shapes, tops, mark } of views) {
      const own = compared || run.index === Store.state.run;
      const shape = own ? shapes.get(Store.state.cell) : undefined;
      const bar = tops.get(Store.state.cell);
      mark.setAttribute("d", !shape ? "" : bar ? pointer(...bar) : outline(shape));
    }
  }

  // An arrow from above: a line around a bar that is a pixel wide would hide it.
  const pointer = (middle, top) => `M${middle - 6},0h12l-6,${EDGE}ZM${middle},${EDGE}V${top}`;

  function outline(shape) {
    if (shape.tagName !== "circle") return shape.getAttribute("d");
    const [cx, cy] = ["cx", "cy"].map((name) => Number(shape.getAttribute(name)));
    return `M${cx - 8},${cy}a8,8 0 1,0 16,0a8,8 0 1,0 -16,0Z`;
  }

  function drawAll() {
    const { runs } = Store.state;
    const focused = views.findIndex((view) => view.svg === document.activeElement);
    const drawn = runs.map((run) => draw(run, run.caption));
    let hint = null;
    if (runs.length === 2 && !Store.comparable()) hint = `There is no map of the difference: ${Store.unlike()}.`;
    if (Store.comparable()) {
      const [first, second] = runs;
      const compared = Colors.difference(first, second);
      const { mixed, gaps } = compared;
      if (mixed) hint = `In ${mixed} of ${gaps.size} cells of the difference, only one run has a mean of re-evaluations; the other's fitness is that of a single evaluation, which may have been lucky.`;
      drawn.push(draw(first, `Fitness of ${first.caption} minus ${second.caption}`, compared));
    }
    views = drawn.map((d) => d.view);
    Page.replace(Page.byId("maps"), ...drawn.map((d) => d.figure), hint && Page.make("p", { class: "hint" }, hint));
    if (focused >= 0 && views[focused]) views[focused].svg.focus();
    paint();
    markChosen();
  }

  function start() {
    Store.on("runs layout", drawAll);
    Store.on("color matching dark", paint);
    Store.on("run cell", markChosen);
  }

  return { start, drawAll };
})();
