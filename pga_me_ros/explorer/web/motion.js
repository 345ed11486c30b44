"use strict";
// Recorded episodes: unpacked once, then read at any moment.
const Motion = (() => {
  function unpack(packed, wide) {
    const bytes = Uint8Array.from(atob(packed.data), (letter) => letter.charCodeAt(0));
    const { columns, low, step } = packed;
    const size = wide ? 2 : 1;
    const rows = bytes.length / size / columns;
    const values = new Float64Array(rows * columns);
    for (let i = 0; i < values.length; i += 1) {
      const raw = wide ? bytes[2 * i] + 256 * bytes[2 * i + 1] : bytes[i];
      const k = i % columns;
      values[i] = low[k] + step[k] * raw;
    }
    return { rows, columns, values };
  }

  // Returns a motion as it came, with its frames as numbers.
  function read(content) {
    const strip = content.strip && { names: content.strip.names, low: content.strip.low, high: content.strip.low.map((x, k) => x + 255 * content.strip.step[k]), ...unpack(content.strip, false) };
    return { ...content, ...unpack(content.frames, true), strip, end: content.seconds[content.seconds.length - 1] };
  }

  // The frame before a moment, and how far it is to the next, 0 to 1.
  function place(motion, time) {
    const { seconds } = motion;
    const last = seconds.length - 1;
    if (time >= seconds[last]) return [last, 0];
    let low = 0;
    let high = last;
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (seconds[middle] <= time) low = middle;
      else high = middle;
    }
    return [low, Math.max(0, (time - seconds[low]) / (seconds[high] - seconds[low]))];
  }

  // Position, quaternion and joints at a moment; what lies between two frames is drawn in a straight line.
  function at(motion, time) {
    const [frame, share] = place(motion, time);
    const { columns, values } = motion;
    const pose = Array.from(values.subarray(frame * columns, (frame + 1) * columns));
    if (share > 0) for (let k = 0; k < columns; k += 1) pose[k] += share * (values[(frame + 1) * columns + k] - pose[k]);
    const norm = Math.hypot(...pose.slice(3, 7)) || 1;
    for (let k = 3; k < 7; k += 1) pose[k] /= norm;
    return pose;
  }

  // Meters that the robot went forward (along x) until a moment, and its speed over half a second around it.
  function progress(motion, time) {
    const x = (t) => at(motion, t)[0];
    const [from, to] = [Math.max(0, time - 0.25), Math.min(motion.end, time + 0.25)];
    return { distance: x(time) - x(0), speed: to > from ? (x(to) - x(from)) / (to - from) : 0 };
  }

  return { read, at, progress };
})();

// Where motions come from: the file itself, or the server that simulates them.
const Motions = (() => {
  const kept = new Map();
  const pending = new Map(); // what is being asked for, and how to give it up

  const keyOf = (run, cell, start) => `${run.index} ${run.byCell.get(cell).evaluation} ${start}`;

  function find(run, cell, start) {
    const key = keyOf(run, cell, start);
    if (!kept.has(key)) {
      const asked = new AbortController();
      const found = load(run, cell, start, asked.signal);
      kept.set(key, found);
      pending.set(key, asked);
      const ended = () => pending.get(key) === asked && pending.delete(key);
      found.then(ended, () => ended() && kept.delete(key)); // what failed may be asked for again
      if (kept.size > 40) kept.delete(kept.keys().next().value);
    }
    return kept.get(key);
  }

  // Gives up what the server was asked for and nobody waits for any more, so that it simulates what is wanted now.
  function giveUpAllBut(wanted) {
    const keys = wanted.map(({ run, cell, start }) => keyOf(run, cell, start));
    for (const [key, asked] of pending) {
      if (keys.includes(key)) continue;
      pending.delete(key);
      kept.delete(key);
      asked.abort();
    }
  }

  async function load(run, cell, start, signal) {
    if (!run.model) throw new Error(`No 3-D view: ${run.model_missing}`);
    const own = run.motions && run.motions[cell];
    if (own && own[start]) return Motion.read(own[start]);
    if (run.simulates) return Motion.read(await Live.motion(run, run.byCell.get(cell), start, signal));
    throw new Error(`The motion of cell ${cell} is not in this file; it has those of ${Object.keys(run.motions).length} gaits. Write it again with a larger --motions.`);
  }

  return { find, giveUpAllBut };
})();
