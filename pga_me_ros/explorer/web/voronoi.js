"use strict";
// The cells of a CVT archive in two dimensions: every point belongs to the nearest center.
const Voronoi = (() => {
  // Keeps the part of a convex polygon that is nearer to a than to b.
  function clip(polygon, a, b) {
    const nx = b[0] - a[0];
    const ny = b[1] - a[1];
    const limit = (b[0] * b[0] + b[1] * b[1] - a[0] * a[0] - a[1] * a[1]) / 2;
    const side = (p) => nx * p[0] + ny * p[1] - limit;
    const kept = [];
    for (let i = 0; i < polygon.length; i += 1) {
      const p = polygon[i];
      const q = polygon[(i + 1) % polygon.length];
      const u = side(p);
      const v = side(q);
      if (u <= 0) kept.push(p);
      if ((u < 0 && v > 0) || (u > 0 && v < 0)) {
        const t = u / (u - v);
        kept.push([p[0] + t * (q[0] - p[0]), p[1] + t * (q[1] - p[1])]);
      }
    }
    return kept;
  }

  const squared = (a, b) => (a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2;

  // Returns a polygon per center within the box [[x0, y0], [x1, y1]].
  function cells(centers, [[x0, y0], [x1, y1]]) {
    return centers.map((center, own) => {
      const others = [];
      for (let i = 0; i < centers.length; i += 1) if (i !== own) others.push([squared(center, centers[i]), i]);
      others.sort((a, b) => a[0] - b[0]);
      let polygon = [[x0, y0], [x1, y0], [x1, y1], [x0, y1]];
      let reach = Math.max(...polygon.map((p) => squared(center, p)));
      for (const [distance, i] of others) {
        if (distance > 4 * reach) break; // farther than twice the farthest corner: it takes nothing away
        polygon = clip(polygon, center, centers[i]);
        if (!polygon.length) break;
        reach = Math.max(...polygon.map((p) => squared(center, p)));
      }
      return polygon;
    });
  }

  return { cells };
})();
