"use strict";
// What the cells can be colored by, and with which colors.
const Colors = (() => {
  const RAMP = [[40, 12, 84], [52, 74, 140], [30, 130, 140], [70, 184, 108], [250, 232, 60]];
  const FALLS = [[46, 125, 80], [214, 196, 96], [201, 88, 52], [96, 16, 40]];
  // On a dark page the dark ends would look like empty cells.
  const IN_THE_DARK = new Map([
    [RAMP, [[132, 92, 200], [86, 116, 208], [40, 150, 160], [70, 184, 108], [250, 232, 60]]],
    [FALLS, [[46, 125, 80], [214, 196, 96], [226, 112, 60], [196, 40, 90]]],
  ]);
  // In the middle no gray: empty cells have that.
  const DIVERGING = [[178, 60, 20], [240, 170, 110], [255, 246, 190], [150, 190, 226], [20, 84, 160]];
  // Told apart by the color-blind (Okabe and Ito), by operator.
  const KINDS = ["#999999", "#e69f00", "#0072b2", "#d55e00", "#cc79a7", "#56b4e9", "#009e73", "#f0e442", "#b8336a", "#9467ff"];
  const ONLY = { first: "#7a3b8f", second: "#3f8f3b" };

  const MEASURES = {
    fitness: { title: "fitness (mean where known)", value: (e) => e.promise, ramp: RAMP },
    falls: { title: "share of falls", value: (e) => e.fall_share, ramp: FALLS, range: [0, 1], percent: true },
    spread: { title: "spread of fitness", value: (e) => e.fitness_spread, ramp: RAMP },
    generation: { title: "generation", value: (e) => e.generation, ramp: RAMP },
    operator: { title: "operator", value: (e) => e.made_by, kinds: true },
  };

  const rampOf = (measure) => (Store.state.dark ? IN_THE_DARK.get(measure.ramp) : measure.ramp);

  function onRamp(ramp, share) {
    const place = Math.min(1, Math.max(0, share)) * (ramp.length - 1);
    const k = Math.min(ramp.length - 2, Math.floor(place));
    const mixed = ramp[k].map((a, i) => Math.round(a + (place - k) * (ramp[k + 1][i] - a)));
    return `rgb(${mixed.join(",")})`;
  }

  // The values of the ends of a scale: beyond them are outliers, at most 2 % of the values (core/archive/color_range.py).
  function range(values) {
    const ordered = values.filter((value) => value !== null && value !== undefined).sort((a, b) => a - b);
    if (!ordered.length) return [0, 1];
    const last = ordered.length - 1;
    const [first, third] = [ordered[Math.floor(last / 4)], ordered[last - Math.floor(last / 4)]];
    const spread = 3 * (third - first);
    const beyond = Math.max(1, Math.floor(0.02 * ordered.length));
    if (!(spread > 0 && last > 2 * beyond)) return [ordered[0], ordered[last]];
    const low = Math.max(ordered[0], Math.min(ordered[beyond], first - spread));
    return [low, Math.min(ordered[last], Math.max(ordered[last - beyond], third + spread))];
  }

  // One scale for all runs, so that equal colors mean equal values in each map.
  function scale(key, runs) {
    const measure = MEASURES[key];
    if (measure.kinds) {
      const names = Object.keys(runs[0].operators);
      return { measure, color: (elite) => KINDS[Math.max(0, names.indexOf(elite.made_by)) % KINDS.length] };
    }
    const values = runs.flatMap((run) => run.elites.map(measure.value));
    const [low, high] = measure.range || range(values);
    const [least, most] = Numbers.range(values);
    const color = (elite) => {
      const value = measure.value(elite);
      if (value === null) return null;
      return onRamp(rampOf(measure), high > low ? (value - low) / (high - low) : 1);
    };
    return { measure, low, high, below: least < low, above: most > high, color };
  }

  // The first run minus the second, cell by cell; `mixed` cells have a mean on one side only.
  function difference(first, second) {
    const gaps = new Map();
    let mixed = 0;
    for (const elite of first.elites) {
      const other = second.byCell.get(elite.cell);
      if (!other) continue;
      gaps.set(elite.cell, elite.promise - other.promise);
      mixed += elite.judged !== other.judged;
    }
    const sizes = [...gaps.values()].map(Math.abs);
    const most = range(sizes)[1] || 1;
    const beyond = sizes.some((size) => size > most);
    const color = (cell) => {
      if (gaps.has(cell)) return onRamp(DIVERGING, 0.5 + gaps.get(cell) / most / 2);
      return first.byCell.has(cell) ? ONLY.first : ONLY.second;
    };
    return { gaps, mixed, most, beyond, color, ramp: DIVERGING };
  }

  // A ramp between the values of its ends, which must not be torn apart at the end of a line.
  function key(colors, low, high) {
    const gradient = `linear-gradient(to right, ${colors.map((c) => `rgb(${c.join(",")})`).join(", ")})`;
    return Page.make("span", { class: "key" }, low, Page.make("span", { class: "ramp", style: `background:${gradient}` }), high);
  }

  function swatch(color, title) {
    return Page.make("span", {}, Page.make("span", { class: "swatch", style: `background:${color}` }), title);
  }

  function legend(place, name, runs, compared) {
    const { measure, low, high, below, above, color } = scale(name, runs);
    const parts = [];
    const word = (text) => Page.make("span", {}, text);
    if (measure.kinds) {
      const used = new Set(runs.flatMap((run) => run.elites.map((e) => e.made_by)));
      for (const made_by of used) parts.push(swatch(color({ made_by }), runs[0].operators[made_by] || made_by));
    } else {
      const text = measure.percent ? Numbers.percent : Numbers.text;
      parts.push(word(measure.title), key(rampOf(measure), `${below ? "≤ " : ""}${text(low)}`, `${above ? "≥ " : ""}${text(high)}`));
      if (runs.some((run) => run.elites.some((e) => measure.value(e) === null))) {
        parts.push(swatch("var(--soft)", "not re-evaluated"));
      }
    }
    parts.push(swatch("var(--empty)", "empty"));
    if (compared) {
      const { most, beyond } = difference(...runs);
      parts.push(word("difference"), key(DIVERGING, `${beyond ? "≤ " : ""}${Numbers.text(-most)}`, `${beyond ? "≥ " : ""}${Numbers.text(most)}`));
      parts.push(swatch(ONLY.first, "only in the first"), swatch(ONLY.second, "only in the second"));
    }
    Page.replace(place, ...parts);
  }

  return { MEASURES, range, scale, difference, swatch, legend };
})();
