// Small parts that several pages have.

import { changed, element, showText } from "./elements.js";

export const problem = () => element("p", { className: "problem" });

export const waiting = (part, what) => (seconds) => showText(part, `${what}${seconds > 1 ? `, ${Math.round(seconds)} s` : ""} …`);

// rows: {check, verdict, text} each, of `companion check`.
export function findings(home, rows) {
  changed(home, rows, () => home.replaceChildren(rows.length === 0 ? "" : element("ul", { className: "findings" }, ...rows.map(({ check, verdict, text }) =>
    element("li", {}, element("span", { className: "verdict", tone: verdict }, verdict), element("span", {}, element("b", {}, check), ` ${text}`))))));
}

export const button = (text, onclick, properties = {}) => element("button", { type: "button", onclick, ...properties }, text);
