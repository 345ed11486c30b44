"use strict";
// Choosing: limits, the nearest to a descriptor, and a table that sorts.
const Choice = (() => {
  const FIRST = 60;
  const MOST = 1000; // which one request can ask for
  const sorting = { key: "promise", up: false };
  let all = false;
  let described = ""; // descriptor that the form is made for

  const COLUMNS = [
    { key: "cell", title: "cell", value: (e) => e.cell },
    { key: "promise", title: "fitness", value: (e) => e.promise },
    { key: "spread", title: "spread", value: (e) => e.fitness_spread },
    { key: "falls", title: "falls", value: (e) => e.fall_share, text: Numbers.percent },
    { key: "descriptor", title: "descriptor", value: (e) => e.promised[0], text: (_, e) => Numbers.list(e.promised) },
    { key: "found", title: "when found", value: (e) => e.fitness },
    { key: "repeats", title: "re-evaluations", value: (e) => e.repeats },
    { key: "made_by", title: "operator", value: (e) => e.made_by, text: (v) => Store.run().operators[v] || v },
    { key: "generation", title: "generation", value: (e) => e.generation },
  ];

  function field(name, title, attributes = {}) {
    return Page.make("label", {}, title, Page.make("input", { name, id: `filter-${name}`, inputmode: "decimal", autocomplete: "off", ...attributes }));
  }

  // Makes the fields; what was typed stays as long as the descriptor is the same.
  function makeForm() {
    const { spec } = Store.run();
    const names = spec.descriptor_names.join(", ");
    if (names === described) return;
    described = names;
    Page.replace(
      Page.byId("filter"),
      field("descriptor", `Nearest to (${names})`, { class: "wide", placeholder: spec.descriptor_low.map((low, k) => ((low + spec.descriptor_high[k]) / 2).toFixed(1)).join(" ") }),
      field("count", "How many nearest", { placeholder: "5" }),
      field("fitness", "Minimum fitness"),
      field("falls", "Maximum falls, %"),
      Page.make("label", {}, "Operator", Page.make("select", { name: "operator", id: "filter-operator" })),
      Page.make("button", { type: "reset", id: "filter-reset" }, "Show all"),
      Page.make("button", { type: "button", id: "filter-copy", onclick: copyRequest }, "Copy as ros2 service call"),
    );
  }

  // Offers the operators that made gaits of this run, and the chosen one, though all of its gaits may be gone.
  function offerOperators() {
    const run = Store.run();
    const select = Page.byId("filter-operator");
    const chosen = select.value;
    const operators = [...new Set([...run.elites.map((e) => e.made_by), chosen])].filter(Boolean).sort();
    const choices = [["", "any"], ...operators.map((o) => [o, run.operators[o] || o])];
    if ([...select.options].map((o) => o.value).join() === choices.map(([o]) => o).join()) return; // it may be open
    Page.options(select, choices, ""); // which "Show all" returns to
    select.value = chosen;
  }

  // Copies the request that makes the same choice, or says why there is none.
  function copyRequest() {
    const limits = wanted();
    const { problems, operator } = limits;
    if (operator) problems.push("no request chooses by operator; choose any");
    if (problems.length) Page.say(`Not copied: ${problems.join("; ")}.`, "filter");
    else Page.copy(Commands.nearest(Store.run(), limits, matches(limits).length), "filter");
  }

  // Numbers as they were typed; a word that is none is reported, not ignored.
  function number(text, name, problems) {
    if (!text.trim()) return null;
    const value = Number(text.replace("%", "").trim());
    if (Number.isFinite(value)) return value;
    problems.push(`${name} is '${text}'; give a number`);
    return null;
  }

  function wanted() {
    const form = Page.byId("filter");
    const text = (name) => form.elements[name].value;
    const problems = [];
    const d = Store.run().spec.descriptor_names.length;
    const words = text("descriptor").split(/[\s,[\]]+/).filter(Boolean);
    const descriptor = words.map((word) => number(word, "the descriptor", problems));
    if (words.length && words.length !== d) problems.push(`the descriptor has ${words.length} entries; give ${d}`);
    const count = number(text("count"), "the count", problems);
    if (count !== null && !(Number.isInteger(count) && count >= 1 && count <= MOST)) problems.push(`the count must be a whole number from 1 to ${MOST}`);
    const falls = number(text("falls"), "the share of falls", problems);
    if (falls !== null && !(falls >= 0 && falls <= 100)) problems.push("the share of falls must be from 0 to 100 %");
    return {
      problems,
      descriptor: words.length && !problems.length ? descriptor : null,
      count: count || 5,
      fitness: number(text("fitness"), "the fitness", problems),
      falls: falls === null ? null : falls / 100,
      operator: text("operator"),
    };
  }

  // Distance in shares of the range, as the services measure it.
  function distance(elite, descriptor) {
    const { descriptor_low: low, descriptor_high: high } = Store.run().spec;
    return Math.hypot(...descriptor.map((x, k) => (elite.promised[k] - x) / (high[k] - low[k])));
  }

  function matches(limits) {
    let found = Store.run().elites.filter(
      (e) =>
        (limits.fitness === null || e.promise >= limits.fitness) &&
        (limits.falls === null || (e.fall_share !== null && e.fall_share <= limits.falls)) &&
        (!limits.operator || e.made_by === limits.operator),
    );
    if (limits.descriptor) {
      found = found.map((e) => [distance(e, limits.descriptor), e]).sort((a, b) => a[0] - b[0] || a[1].cell - b[1].cell);
      found = found.slice(0, limits.count).map(([, e]) => e);
    }
    return found;
  }

  function sorted(rows) {
    const { value } = COLUMNS.find((c) => c.key === sorting.key);
    const sign = sorting.up ? 1 : -1;
    return [...rows].sort((a, b) => {
      const [u, v] = [value(a), value(b)];
      if (u === null || v === null) return (u === null) - (v === null); // unknown ones last, whichever way
      return sign * (u < v ? -1 : u > v ? 1 : 0) || a.cell - b.cell;
    });
  }

  function header(column) {
    const here = sorting.key === column.key;
    const sort = here ? (sorting.up ? "ascending" : "descending") : "none";
    const act = () => {
      sorting.up = here ? !sorting.up : false;
      sorting.key = column.key;
      draw();
      Page.byId(`sort-${column.key}`).focus();
    };
    const mark = here ? (sorting.up ? " ▲" : " ▼") : "";
    return Page.make("th", { scope: "col", "aria-sort": sort }, Page.make("button", { type: "button", id: `sort-${column.key}`, onclick: act }, column.title + mark));
  }

  function row(elite) {
    const here = elite.cell === Store.state.cell;
    const cells = COLUMNS.slice(1).map(({ value, text }) => Page.make("td", {}, text ? text(value(elite), elite) : Numbers.text(value(elite))));
    const act = () => Store.set({ cell: elite.cell });
    return Page.make("tr", { class: here ? "here" : "", "data-row": elite.cell }, Page.make("td", {}, Page.make("button", { type: "button", onclick: act, "aria-label": `Play cell ${elite.cell}` }, String(elite.cell))), ...cells);
  }

  function draw() {
    const limits = wanted();
    const found = limits.problems.length ? [] : matches(limits);
    const rows = sorted(found);
    const line = document.activeElement && document.activeElement.closest("tr[data-row]");
    const focused = line && line.dataset.row;
    const shown = all ? rows : rows.slice(0, FIRST);
    Page.replace(
      Page.byId("table"),
      Page.make("thead", {}, Page.make("tr", {}, ...COLUMNS.map(header))),
      Page.make("tbody", {}, ...shown.map(row)),
    );
    const again = focused && Page.byId("table").querySelector(`tr[data-row="${focused}"] button`);
    if (again) again.focus();
    Page.byId("matches").classList.toggle("warn", limits.problems.length > 0);
    Page.byId("matches").textContent = limits.problems.length
      ? `${limits.problems.join("; ")}.`
      : `${rows.length} of ${Store.run().elites.length} gaits`;
    const rest = rows.length - shown.length;
    Page.replace(Page.byId("more"), rest ? Page.make("button", { type: "button", onclick: showAll }, `Show ${rest} more`) : null);
    const narrowed = rows.length < Store.run().elites.length;
    Store.set({ matching: narrowed ? new Set(rows.map((e) => e.cell)) : null });
  }

  function showAll() {
    all = true;
    draw();
  }

  function markRow() {
    for (const line of Page.byId("table").querySelectorAll("tr[data-row]")) {
      line.className = Number(line.dataset.row) === Store.state.cell ? "here" : "";
    }
  }

  function start() {
    const form = Page.byId("filter");
    form.addEventListener("input", draw);
    form.addEventListener("reset", () => setTimeout(draw)); // the fields are emptied after the event
    form.addEventListener("submit", (event) => event.preventDefault());
    Store.on("runs run", () => {
      makeForm();
      offerOperators();
      draw();
    });
    Store.on("cell", markRow);
  }

  return { start };
})();
