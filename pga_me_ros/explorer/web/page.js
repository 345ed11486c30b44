"use strict";
// Elements of the page.
const Page = {
  byId: (id) => document.getElementById(id),

  make(tag, attributes = {}, ...children) {
    return Page.fill(document.createElement(tag), attributes, children);
  },

  svg(tag, attributes = {}, ...children) {
    return Page.fill(document.createElementNS("http://www.w3.org/2000/svg", tag), attributes, children);
  },

  fill(element, attributes, children) {
    for (const [name, value] of Object.entries(attributes)) {
      if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
      else if (value === true) element.setAttribute(name, "");
      else if (value !== false && value !== null && value !== undefined) element.setAttribute(name, value);
    }
    element.append(...children.filter((child) => child !== null && child !== undefined));
    return element;
  },

  replace(element, ...children) {
    element.replaceChildren(...children.filter((child) => child !== null && child !== undefined));
  },

  options(select, choices, chosen) {
    Page.replace(select, ...choices.map(([value, title]) => Page.make("option", { value, selected: value === chosen }, title)));
    if (choices.length) select.value = choices.some(([value]) => value === chosen) ? chosen : choices[0][0];
  },

  warnings: {},

  // What is wrong, where everybody sees it, one warning about each thing; an empty text takes it away.
  warn(about, text) {
    Page.warnings[about] = text;
    const place = Page.byId("message");
    const texts = Object.values(Page.warnings).filter(Boolean);
    place.hidden = !texts.length;
    place.textContent = texts.join("\n");
  },

  // What a button has to say, below it: `place` is what the button stands in.
  say(text, place) {
    const said = Page.byId("copied");
    if (said.previousElementSibling !== Page.byId(place)) Page.byId(place).after(said);
    said.textContent = text;
  },

  async copy(text, place) {
    Page.say(text, place);
    try {
      await navigator.clipboard.writeText(text);
    } catch {
      // Browsers keep the clipboard from pages that came over plain HTTP; this older way works there, too.
      const box = Page.make("textarea", { readonly: true, style: "position:fixed;opacity:0" });
      box.value = text;
      document.body.append(box);
      box.select();
      document.execCommand("copy");
      box.remove();
    }
  },

  color: (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim(),
};
