// Puts what `model.js` made into the page. No network, and no decision: what is given is what is shown.

import { CallView, legend } from "./call_view.js";
import { arrange, changed, element, showText } from "./elements.js";
import { KnownPlace } from "./place.js";
import { Fan, TimePlot } from "./plots.js";
import { Words } from "./words.js";

export function showState(state) {
  changed("state", { ...state, since: "" }, (part) => {
    part.dataset.tone = state.tone;
    document.title = `${state.title} · AnyTraverse`;
    document.body.classList.toggle("stale", state.stale);
  });
  showText("state-title", state.title);
  showText("state-why", state.why);
  showText("state-since", state.since);
}

export function showPictureNote({ text, fresh }) {
  showText("picture-note", text);
  changed("view", fresh, (part) => part.classList.toggle("stale", !fresh));
}

const known = new KnownPlace("h3");
const fan = new Fan();
const drivable = new TimePlot("Drivable", { above: false, at: 1 });
const unexplained = new TimePlot("Unexplained", { above: true, at: 2 });
const words = new Words("");
document.getElementById("views").append(known.part);
document.querySelector("#view figcaption").append(legend("look here"));
document.getElementById("ahead").append(fan.part, drivable.part, unexplained.part);
document.getElementById("words").append(words.part);

// points, time: of the rover's clock.
export function showAhead({ ahead, state }, points, time) {
  const limits = state?.settings ?? {};
  fan.show(ahead ?? null);
  drivable.show(points, limits.AT_THR_TRAV, time);
  unexplained.show(points, limits.AT_THR_ROI, time);
}

export function showPlace({ state }) {
  known.show(state?.known_place);
}

export function showWords(shown) {
  words.show({ words: shown, words_known: true, calls: [] });
}

const cards = new Map();

export function showCalls(calls, time) {
  const keys = new Set(calls.map((call) => call.key));
  for (const [key, card] of cards) if (!keys.has(key)) card.part.remove(), cards.delete(key);
  for (const call of calls) {
    if (!cards.has(call.key)) cards.set(call.key, new CallView());
    cards.get(call.key).show(call, time);
  }
  const parts = (open) => calls.filter((call) => call.open === open).map((call) => cards.get(call.key).part);
  arrange(document.getElementById("open"), parts(true));
  arrange(document.getElementById("past"), parts(false), 1);
  document.getElementById("past").hidden = !parts(false).length;
}

export function showChecks({ summary, rows }) {
  changed("check", { summary, rows }, (part) => {
    const cells = rows.map(({ check, verdict, text }) =>
      element("tr", {},
        element("td", {}, element("span", { className: "verdict", tone: verdict }, verdict)),
        element("th", { scope: "row" }, check),
        element("td", {}, text)));
    const head = element("thead", {}, element("tr", {}, ...["verdict", "check", "what was found, and what to do"]
      .map((name) => element("th", { scope: "col" }, name))));
    part.replaceChildren(element("p", {}, summary), rows.length ? element("table", {}, head, element("tbody", {}, ...cells)) : "");
  });
}

export function showLog(lines) {
  changed("log", lines, (part) => {
    const follows = part.scrollTop + part.clientHeight >= part.scrollHeight - 8;
    part.replaceChildren(...lines.map(({ line, tone }) => element("span", { tone }, `${line}\n`)));
    if (follows) part.scrollTop = part.scrollHeight;
  });
}
