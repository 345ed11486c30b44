"use strict";
// The server's side of the page: motions it simulates, news of the run, and what the run is told.
const Live = (() => {
  const RETRY = 3000; // milliseconds
  let versions = [];
  let fetching = false;
  let retry = 0;
  let shown = [];

  // Returns the server's answer; its refusals become errors with its words.
  async function answered(path, options) {
    let answer;
    try {
      answer = await fetch(path, options);
    } catch {
      throw new Error("The explorer's server does not answer; is it still running?");
    }
    if (answer.ok) return answer;
    const text = await answer.text();
    let words = text;
    try {
      words = JSON.parse(text).error;
    } catch {
      // Plain words already.
    }
    throw new Error(words);
  }

  const ask = async (path, options) => (await answered(path, options)).json();
  // The evaluation says which gait is meant: by now, the server may have another one in the cell.
  const motion = (run, { cell, evaluation }, start, signal) =>
    ask(`api/motion/${run.index}/${cell}?evaluation=${evaluation}&start=${encodeURIComponent(start)}`, { signal });

  // Fetches a file and hands it to the browser; what a link would download without a word may be refused, or take long.
  async function download(run, elite, kind) {
    const say = (text) => Page.say(text, "actions");
    say(`Making the ${kind} file …`);
    try {
      const answer = await answered(`api/download/${run.index}/${elite.cell}/${kind}?evaluation=${elite.evaluation}`);
      const [, name] = /filename="(.+)"/.exec(answer.headers.get("Content-Disposition"));
      const href = URL.createObjectURL(await answer.blob());
      Page.make("a", { href, download: name }).click();
      setTimeout(() => URL.revokeObjectURL(href), 60_000); // when the browser has surely taken it
      say(`Downloaded ${name}`);
    } catch (error) {
      say(error.message);
    }
  }

  async function send(index, action, values) {
    const said = Page.byId(`said-${index}`);
    said.textContent = "…";
    try {
      const answer = await ask(`api/control/${index}`, { method: "POST", headers: { "X-Explorer": "1" }, body: JSON.stringify({ action, values }) });
      said.textContent = answer.said;
    } catch (error) {
      said.textContent = error.message;
    }
  }

  // Fetches what has changed, one run at a time, until it has what the newest news tell; what failed is tried again.
  async function catchUp() {
    if (fetching) return;
    fetching = true;
    clearTimeout(retry);
    try {
      for (;;) {
        const i = shown.findIndex((n, k) => n.version !== versions[k]);
        if (i < 0) break;
        const { version } = shown[i]; // the content may be newer; news of that will come
        const content = await ask(`api/run/${i}`);
        Page.warn("server", "");
        versions[i] = version;
        Explorer.update(i, content);
      }
    } catch (error) {
      Page.warn("server", error.message);
      retry = setTimeout(catchUp, RETRY);
    } finally {
      fetching = false;
    }
  }

  function take(news) {
    shown = news;
    Page.warn("server", "");
    Page.warn("runs", news.map((n) => n.problem).filter(Boolean).join("\n"));
    catchUp();
    news.forEach((n, i) => n.state && panels[i] && draw(panels[i], n.state, i));
  }

  const panels = [];

  function time(seconds) {
    if (seconds === null) return "unknown";
    return seconds < 90 ? `${Math.round(seconds)} s` : seconds < 5400 ? `${Math.round(seconds / 60)} min` : `${(seconds / 3600).toFixed(1)} h`;
  }

  function progress(p) {
    if (!p) return "No run is under way; the repertoire is served.";
    const again = p.final_budget ? `, ${p.final_reevaluations} of ${p.final_budget} re-evaluations` : "";
    return `${p.state}: generation ${p.generation + 1} of ${p.generations}, ${Numbers.text(p.evaluations)} of ${Numbers.text(p.budget)} evaluations${again}, ${Numbers.text(p.rate)} per second, ${time(p.eta)} left, ${p.evaluators} evaluator${p.evaluators === 1 ? "" : "s"}, ${p.restarts} restart${p.restarts === 1 ? "" : "s"}`;
  }

  // Makes the panel of a graph once; what changes is filled in by draw().
  function makePanel(index, control) {
    const button = (action, title) => Page.make("button", { type: "button", id: `do-${action}-${index}`, disabled: !control, onclick: () => send(index, action) }, title);
    const panel = {
      line: Page.make("p", { id: `progress-${index}`, role: "status" }),
      rates: Page.make("form", {}),
      nodes: Page.make("div", { class: "scroll" }),
      log: Page.make("pre", { class: "log", tabindex: 0, "aria-label": "Log" }),
      told: {},
    };
    panel.rates.addEventListener("submit", (event) => {
      event.preventDefault();
      const values = {};
      for (const input of panel.rates.querySelectorAll("input")) if (input.value !== input.defaultValue) values[input.name] = Number(input.value);
      send(index, "rates", values);
    });
    const many = Store.state.runs.length > 1;
    Page.byId("control").append(
      ...(many ? [Page.make("h3", {}, Store.state.runs[index].caption)] : []),
      panel.line,
      Page.make(
        "div",
        { class: "bar" },
        button("pause", "Pause run"),
        button("resume", "Resume run"),
        button("stop", "Stop run"),
        Page.make("button", { type: "button", id: `show-rates-${index}`, disabled: !control, onclick: () => send(index, "rates") }, "Rates"),
        Page.make("output", { id: `said-${index}` }, control ? "" : "This page is read-only; --control lets it control the run."),
      ),
      panel.rates,
      panel.nodes,
      panel.log,
    );
    panels[index] = panel;
  }

  // Whether a part of the state differs from what is on the page; typed values must not be overwritten.
  function differs(panel, name, value) {
    const text = JSON.stringify(value);
    if (panel.told[name] === text) return false;
    panel.told[name] = text;
    return true;
  }

  function draw(panel, state, index) {
    panel.line.textContent = progress(state.progress);
    if (differs(panel, "rates", state.rates)) drawRates(panel.rates, state.rates, index);
    if (differs(panel, "nodes", state.nodes)) drawNodes(panel.nodes, state.nodes);
    if (differs(panel, "log", state.log)) {
      panel.log.textContent = state.log.join("\n") || "No line of the log since this explorer was started.";
      panel.log.scrollTop = panel.log.scrollHeight;
    }
  }

  function drawRates(form, rates, index) {
    const limit = (value) => (value === null || value === undefined ? null : value);
    const fields = rates.map(({ name, value, whole, description, low, high }) => {
      const range = [["from", low], ["to", high]].filter(([, value]) => limit(value) !== null).flat().join(" ");
      return Page.make("label", { title: description }, name, Page.make("span", { class: "hint" }, range), Page.make("input", { name, id: `rate-${name}-${index}`, type: "number", required: true, step: whole ? 1 : "any", value, min: limit(low), max: limit(high) }));
    });
    Page.replace(form, ...fields, rates.length ? Page.make("button", { type: "submit", id: `set-rates-${index}` }, "Set from the next generation on") : null);
  }

  function drawNodes(place, nodes) {
    const keys = [...new Set(nodes.flatMap((node) => Object.keys(node)))].filter((key) => key !== "node");
    Page.replace(
      place,
      nodes.length
        ? Page.make(
            "table",
            {},
            Page.make("thead", {}, Page.make("tr", {}, ...["node", ...keys].map((key) => Page.make("th", { scope: "col" }, key)))),
            Page.make("tbody", {}, ...nodes.map((node) => Page.make("tr", {}, ...["node", ...keys].map((key) => Page.make("td", {}, node[key] || ""))))),
          )
        : null,
    );
  }

  function start(content) {
    versions = content.runs.map((run) => run.version);
    content.runs.forEach((run, i) => run.served && makePanel(i, content.control));
    const news = new EventSource("api/events");
    news.addEventListener("message", (event) => take(JSON.parse(event.data)));
    news.addEventListener("error", () => Page.warn("server", "The explorer's server does not answer; the page shows its last state and tries again."));
    window.addEventListener("pagehide", () => news.close());
  }

  return { start, motion, download, state: () => shown };
})();
