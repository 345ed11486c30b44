"use strict";
// Where each cell is drawn: shapes in a square from 0 to 1, y upwards.
const Layouts = (() => {
  const box = (x0, y0, x1, y1) => [[x0, y0], [x1, y0], [x1, y1], [x0, y1]];

  function title(run, k) {
    return run.spec.descriptor_names[k].replaceAll("_", " ");
  }

  function axis(run, k) {
    return { title: title(run, k), low: run.spec.descriptor_low[k], high: run.spec.descriptor_high[k] };
  }

  // Bins of a cell of a grid archive; the last dimension varies fastest.
  function binsOf(cell, bins) {
    const where = [];
    for (let k = bins.length - 1; k >= 0; k -= 1) {
      where[k] = cell % bins[k];
      cell = Math.floor(cell / bins[k]);
    }
    return where;
  }

  const unit = (run) => (point) => point.map((x, k) => {
    const [low, high] = [run.archive.box[0][k], run.archive.box[1][k]];
    return (x - low) / (high - low);
  });

  // One dimension: a bar per cell, as high as the gait is fit; two runs have one scale.
  function bars(run, elites) {
    const toUnit = unit(run);
    const centers = run.archive.centers.map((c, cell) => [toUnit(c)[0], cell]).sort((a, b) => a[0] - b[0]);
    const byCell = new Map(elites.map((e) => [e.cell, e]));
    const [low, high] = Numbers.range(Store.state.runs.flatMap((each) => each.elites.map((e) => e.promise)));
    const floor = Math.min(0, low);
    const shapes = centers.map(([x, cell], i) => {
      const left = i ? (centers[i - 1][0] + x) / 2 : 0;
      const right = i + 1 < centers.length ? (x + centers[i + 1][0]) / 2 : 1;
      const elite = byCell.get(cell);
      const top = elite ? Math.max(0.012, (elite.promise - floor) / (high - floor || 1)) : 1;
      return { cell, points: box(left, 0, right, top) };
    });
    return { shapes, x: axis(run, 0), y: { title: "fitness", low: floor, high }, height: 0.62, bars: true };
  }

  // Cells never move, so a run that grows has its borders computed once.
  const kept = new Map();

  function borders(run) {
    const key = `${run.run.run_id} ${run.archive.cells}`;
    if (!kept.has(key)) kept.set(key, Voronoi.cells(run.archive.centers, run.archive.box).map((polygon) => polygon.map(unit(run))));
    return kept.get(key);
  }

  function plane(run) {
    const { bins, cells } = run.archive;
    const shapes = [];
    if (bins.length) {
      for (let cell = 0; cell < cells; cell += 1) {
        const [i, j] = binsOf(cell, bins);
        shapes.push({ cell, points: box(i / bins[0], j / bins[1], (i + 1) / bins[0], (j + 1) / bins[1]) });
      }
    } else {
      borders(run).forEach((points, cell) => shapes.push({ cell, points }));
    }
    return { shapes, x: axis(run, 0), y: axis(run, 1), height: 1 };
  }

  const shareOf = (run, elite, k) => {
    const [low, high] = [run.spec.descriptor_low[k], run.spec.descriptor_high[k]];
    return Math.min(1, Math.max(0, (elite.descriptor[k] - low) / (high - low)));
  };

  // Maps within maps: dimensions 0, 2, 4... to the right, the first outermost, 1, 3, 5... upwards. Elites of a CVT archive
  // are put into even bins; where several share one, the fittest is drawn.
  function nested(run, elites) {
    const d = run.spec.descriptor_names.length;
    const even = Math.max(2, Math.round(run.archive.cells ** (1 / d)));
    const bins = run.archive.bins.length ? run.archive.bins : Array(d).fill(even);
    const dims = [0, 1].map((first) => bins.map((_, k) => k).filter((k) => k % 2 === first));
    const counts = dims.map((ks) => ks.reduce((n, k) => n * bins[k], 1));
    const place = (where, ks) => ks.reduce((at, k) => at * bins[k] + where[k], 0);
    const shown = new Map();
    for (const elite of elites) {
      const where = run.archive.bins.length
        ? binsOf(elite.cell, bins)
        : bins.map((n, k) => Math.min(n - 1, Math.floor(shareOf(run, elite, k) * n)));
      const key = place(where, dims[0]) + counts[0] * place(where, dims[1]);
      const before = shown.get(key);
      if (!before || elite.promise > before.promise) shown.set(key, elite);
    }
    const shapes = [];
    for (const [key, elite] of shown) {
      const i = key % counts[0];
      const j = Math.floor(key / counts[0]);
      shapes.push({ cell: elite.cell, points: box(i / counts[0], j / counts[1], (i + 1) / counts[0], (j + 1) / counts[1]) });
    }
    const lines = [0, 1].map((side) => {
      const ks = dims[side];
      return Array.from({ length: bins[ks[0]] - 1 }, (_, i) => (i + 1) / bins[ks[0]]);
    });
    const name = (ks) => ({ title: ks.map((k) => title(run, k)).join(",\nwithin it "), low: run.spec.descriptor_low[ks[0]], high: run.spec.descriptor_high[ks[0]] });
    return { shapes, lines, background: true, x: name(dims[0]), y: dims[1].length ? name(dims[1]) : { title: "", low: 0, high: 1 }, height: 1 };
  }

  // Two chosen axes: a dot per elite, where its descriptor is.
  function dots(run, elites, i, j) {
    const fittestLast = [...elites].sort((a, b) => a.promise - b.promise); // on top of the others
    const shapes = fittestLast.map((e) => ({ cell: e.cell, dot: [shareOf(run, e, i), shareOf(run, e, j)] }));
    return { shapes, background: true, x: axis(run, i), y: axis(run, j), height: 1 };
  }

  // The ways to draw a run's archive, the usual one first.
  function choices(run) {
    const d = run.spec.descriptor_names.length;
    const list = [["cells", d === 1 ? "bars" : d === 2 ? "cells" : "maps within maps"]];
    for (let i = 0; i < d; i += 1) {
      for (let j = i + 1; j < d; j += 1) list.push([`dots:${i},${j}`, `${title(run, i)} × ${title(run, j)}`]);
    }
    return list;
  }

  // With another run, what only that one has is drawn, too.
  function of(run, name, other) {
    const elites = [...run.elites, ...(other ? other.elites.filter((e) => !run.byCell.has(e.cell)) : [])];
    const pair = /^dots:(\d+),(\d+)$/.exec(name || "");
    const d = run.spec.descriptor_names.length;
    if (pair && Number(pair[2]) < d) return dots(run, elites, Number(pair[1]), Number(pair[2]));
    return d === 1 ? bars(run, elites) : d === 2 ? plane(run) : nested(run, elites);
  }

  return { choices, of };
})();
