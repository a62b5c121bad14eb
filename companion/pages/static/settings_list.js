// All settings of the file by section, with a search.

import { element, showText } from "./elements.js";
import { Field, written } from "./fields.js";

// store: of `Field`, and {rows}: a map of all. shell: command to set a row that cannot be set on this page, "" for one that can.
export class SettingsList {
  constructor(store, { shell = () => "", note = "" } = {}) {
    Object.assign(this, { store, note });
    this.search = element("input", { type: "text", id: "search", autocomplete: "off", oninput: () => this.filter() });
    this.count = element("p", { className: "faint", role: "status" });
    this.fields = [];
    this.sections = [...grouped(store.rows.values())].map(([name, rows]) => {
      const fields = rows.map((row) => {
        const how = row.form.example ? ` One a line, as ${row.form.example}.` : "";
        const help = `${row.help.replace(/ ?\.\.\.$/, "")}.${how} Default: ${text(row.default)}.`, command = shell(row);
        return { row, field: command ? told(row, help, command) : new Field(store, row.key, { help }) };
      });
      this.fields.push(...fields);
      return { fields, part: element("fieldset", {}, element("legend", {}, `[${name}]`), ...fields.map(({ field }) => field.part)) };
    });
    this.part = element("div", { className: "settings" },
      element("div", { className: "row" }, element("label", { for: "search" }, "Search"), this.search), this.count, ...this.sections.map(({ part }) => part));
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
    showText(this.count, `${count} of ${this.fields.length} settings. ${this.note}`);
  }

  show() {
    this.fields.forEach(({ field }) => field.show?.());
  }
}

// diff: unified. Its lines by what they do.
export const differences = (diff) => diff.split("\n").map((line) =>
  element("span", { tone: /^(---|\+\+\+)/.test(line) ? "" : { "+": "new", "-": "old" }[line[0]] ?? "" }, `${line}\n`));

// A setting that is only shown.
function told(row, help, command) {
  const value = row.hidden && row.value === null ? "set, and not shown" : text(row.value);
  return { part: element("div", { className: "setting shell" }, element("b", {}, row.name), element("span", { className: "value" }, value),
    element("p", { className: "faint" }, `${help} In the shell only: `, element("code", {}, command))) };
}

const text = (value) => (value === null ? "not set" : value === "" ? "empty" : written(value, ", ") || "none");

function grouped(rows) {
  const found = new Map();
  for (const row of rows) found.set(row.section, [...(found.get(row.section) ?? []), row]);
  return found;
}
