// All settings of the file by section, with a search.

import { element, showText } from "./elements.js";
import { Field } from "./fields.js";

export class SettingsPage {
  constructor(store) {
    this.store = store;
    this.search = element("input", { type: "text", id: "search", autocomplete: "off", oninput: () => this.filter() });
    this.count = element("p", { className: "faint", role: "status" });
    this.home = element("div");
    this.part = element("section", {}, element("h2", {}, "All settings"),
      element("div", { className: "row" }, element("label", { for: "search" }, "Search"), this.search), this.count, this.home);
  }

  enter() {
    if (this.fields) return;
    const sections = Map.groupBy ? Map.groupBy(this.store.state.settings, (row) => row.section) : grouped(this.store.state.settings);
    this.fields = [];
    this.sections = [...sections].map(([name, rows]) => {
      const fields = rows.map((row) => ({ row, field: new Field(this.store, row.key, { help: `${row.help}. Default: ${text(row.default)}.` }) }));
      this.fields.push(...fields);
      const part = element("fieldset", {}, element("legend", {}, `[${name}]`), ...fields.map(({ field }) => field.part));
      return { part, fields };
    });
    this.home.replaceChildren(...this.sections.map(({ part }) => part));
    this.filter();
  }

  filter() {
    const wanted = this.search.value.trim().toLowerCase().split(/\s+/);
    let count = 0;
    for (const { part, fields } of this.sections) {
      for (const { row, field } of fields) {
        const about = `${row.key} ${row.help}`.toLowerCase();
        field.part.hidden = !wanted.every((word) => about.includes(word));
        count += !field.part.hidden;
      }
      part.hidden = fields.every(({ field }) => field.part.hidden);
    }
    showText(this.count, `${count} of ${this.fields.length} settings. What you change waits on the page Review.`);
  }

  show() {
    this.fields?.forEach(({ field }) => field.show());
  }
}

const text = (value) => (value === null ? "not set" : value === "" ? "empty" : Array.isArray(value) ? value.join(", ") : String(value));

function grouped(rows) {
  const found = new Map();
  for (const row of rows) found.set(row.section, [...(found.get(row.section) ?? []), row]);
  return found;
}
