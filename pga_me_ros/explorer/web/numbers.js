"use strict";
// Numbers as people read them. Unknown ones (null) are a dash.
const Numbers = {
  text(value, digits = 4) {
    if (value === null || value === undefined || Number.isNaN(value)) return "–";
    const size = Math.abs(value);
    if (size >= 1000) return Math.round(value).toLocaleString("en-US");
    if (Number.isInteger(value)) return String(value);
    return size >= 100 ? value.toFixed(1) : String(Number(value.toPrecision(digits)));
  },

  percent(share) {
    return share === null || share === undefined ? "–" : `${Number((100 * share).toFixed(1))} %`;
  },

  list(values, digits = 3) {
    return values && values[0] !== null ? `[${values.map((x) => x.toFixed(digits)).join(", ")}]` : "–";
  },

  // All digits, for commands: JavaScript writes the shortest text that reads back as the same number.
  exact(values) {
    return `[${values.map((x) => (Number.isInteger(x) ? x.toFixed(1) : String(x))).join(", ")}]`;
  },

  range(values) {
    let low = Infinity;
    let high = -Infinity;
    for (const value of values) {
      if (value === null || value === undefined) continue;
      low = Math.min(low, value);
      high = Math.max(high, value);
    }
    return low <= high ? [low, high] : [0, 1];
  },
};
