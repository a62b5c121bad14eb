// An input for a setting of the file: its label, unit and meaning; what is wrong with a value stands below it.

import { element, showText } from "./elements.js";

const EMPTY = "not set";

// store: row(key) returns a row of the settings' list, change({key: value}, waits) resolves to "" or to what is wrong.
// One that refuses has {refused}, too: by key the {value, problem} of what waits, since it was not taken; what it takes
// after all it takes out.
// key: "section.key". name: what stands before it, by default the setting's own. long: whether it may be a long text.
export class Field {
  constructor(store, key, { name = "", help = "", wide = false } = {}) {
    Object.assign(this, { store, key, sending: 0 });
    const id = `f-${key.replace(".", "-")}`;
    this.row = store.row(key);
    this.input = this.made(id);
    this.problem = element("p", { className: "problem", id: `${id}-problem` });
    this.note = element("p", { className: "faint", id: `${id}-help` });
    this.input.setAttribute("aria-describedby", `${id}-help ${id}-problem`);
    this.help = help;
    this.part = element("div", { className: wide ? "setting wide" : "setting" }, element("label", { for: id }, name || this.row.name), this.input, this.note, this.problem);
    this.input.addEventListener("input", () => (this.edited = true));
    this.input.addEventListener("change", () => this.send());
    this.input.addEventListener("blur", () => this.input.value === this.before && (this.edited = false));
    this.show();
  }

  made(id) {
    const { type, options, low, high } = this.row.form;
    if (type === "flag") return element("input", { type: "checkbox", id });
    if (type === "choice") {
      const none = this.row.default === null ? [element("option", { value: "" }, EMPTY)] : [];
      return element("select", { id }, ...none, ...options.map((one) => element("option", { value: one }, one)));
    }
    if (type === "lines" || type === "table") return element("textarea", { id, rows: 4, autocomplete: "off", spellcheck: false, placeholder: EMPTY });
    const input = element("input", { type: "text", id, autocomplete: "off", placeholder: EMPTY });
    if (type === "number" || type === "integer") {
      input.inputMode = "decimal";
      input.title = `${low} to ${high}`;
    }
    return input;
  }

  show() {
    const { refused } = this.store;
    if (refused && !this.sending && document.activeElement !== this.input) this.say((this.edited && refused.get(this.key)?.problem) || "");
    this.draw();
  }

  draw() {
    this.row = this.store.row(this.key);
    const { value, hidden, form, guarded, help } = this.row;
    if (form.type === "flag") this.input.checked = value === true;
    else if (!this.edited || form.type === "choice") this.before = this.input.value = value === null || hidden ? "" : written(value, form.type === "list" ? ", " : "\n");
    // Part of a value in the input would be taken for the whole, and be written.
    this.input.placeholder = !hidden ? EMPTY : value === null ? "set, and not shown" : `${written(value, ", ")} (not shown whole)`;
    this.part.classList.toggle("changed", Boolean(this.row.changed));
    const mark = guarded ? ` ${this.store.mark ?? "Only on this computer."}` : "";
    showText(this.note, `${this.help || help}${this.help ? "" : "."}${mark}`);
  }

  async send() {
    const { value, wrong } = this.read(), typed = this.input.value;
    const nothing = this.row.hidden && typed.trim() === "";
    // What is typed stays, to be mended, and waits for what it goes with; a choice goes back to what is in force.
    const waits = !["choice", "flag"].includes(this.row.form.type);
    if (wrong) this.store.refused?.set(this.key, { problem: wrong });
    this.sending += 1;
    const problem = wrong || nothing ? wrong ?? "" : await this.store.change({ [this.key]: value }, waits);
    this.sending -= 1;
    if (nothing) this.store.refused?.delete(this.key);
    const typedOn = this.input.value !== typed && this.input.value !== this.before;
    this.say(problem);
    this.edited ||= typedOn;
    this.draw();
  }

  // What is wrong with what is typed; without it that counts no more.
  say(problem) {
    this.edited = Boolean(problem);
    showText(this.problem, problem);
    this.input.setAttribute("aria-invalid", problem ? "true" : "false");
  }

  forget() {
    this.say("");
    this.show();
  }

  read() {
    const { type } = this.row.form;
    if (type === "flag") return { value: this.input.checked };
    const text = this.input.value.trim();
    if (text === "" && type === "table") return { value: {} };
    if (text === "" && type === "lines") return { value: [] };
    if (text === "") return { value: this.row.default === "" ? "" : null };
    if (type === "number" || type === "integer") {
      const value = Number(text.replace(",", "."));
      return Number.isFinite(value) ? { value } : { wrong: "That is no number." };
    }
    if (type === "lines") return { value: lines(text) };
    if (type === "table") return table(text, this.row.form.of);
    if (type === "list") return { value: text.split(",").map((one) => one.trim()).map((one) => (one !== "" && Number.isFinite(Number(one)) ? Number(one) : one)) };
    const numeric = Number(text);
    return { value: Number.isFinite(numeric) && typeof this.row.default === "number" ? numeric : text };
  }
}

// A value as somebody writes it. between: what stands between two of a list, or of a table's lines.
export function written(value, between) {
  if (Array.isArray(value)) return value.join(between);
  return value !== null && typeof value === "object" ? Object.entries(value).map(([key, its]) => `${key}: ${its}`).join(between) : String(value);
}

const lines = (text) => text.split("\n").map((line) => line.trim()).filter(Boolean);

// Lines of `key: value`, as a table. of: what its values are: number, text, any.
export function table(text, of) {
  const found = Object.create(null); // "constructor" is a word like any other
  for (const row of lines(text)) {
    const [, quoted, value] = row.match(/^([^:]+):(.*)$/)?.map((part) => part.trim()) ?? [];
    const key = quoted?.replace(/^(["'])(.*)\1$/, "$2");
    if (!key) return { wrong: `Write each line as NAME: VALUE, not "${row}".` };
    if (key in found) return { wrong: `${key} stands twice.` };
    const digits = value.replace("\u2212", "-"); // the sign for minus, as the page writes it
    const isNumber = of !== "text" && /^[+-]?\d*[.,]?\d+$/.test(digits);
    if (of === "number" && !isNumber) return { wrong: `${key}: "${value}" is no number.` };
    found[key] = isNumber ? Number(digits.replace(",", ".")) : value;
  }
  return { value: found };
}

// Fields beside each other. told: key -> options of `Field`.
export function fieldset(store, title, told) {
  const fields = Object.entries(told).map(([key, options]) => new Field(store, key, options));
  const part = element("fieldset", {}, element("legend", {}, title), ...fields.map((field) => field.part));
  return { part, show: () => fields.forEach((field) => field.show()) };
}
