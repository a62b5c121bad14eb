// Puts what `model.js` made into the page. No network, and no decision: what is given is what is shown.

import { AnswerCard } from "./answer_card.js";
import { AnswerBar } from "./bar.js";
import { CallView, legend } from "./call_view.js";
import { Cards, watched } from "./cards.js";
import { changed, element, showText } from "./elements.js";
import { Incident } from "./incident.js";
import { Metres } from "./metres.js";
import { KnownPlace } from "./place.js";
import { Fan, TimePlot } from "./plots.js";
import { say } from "./sending.js";
import { Words } from "./words.js";
import { clock } from "./wording.js";

// calls: how many are open.
export function showState(state, calls) {
  changed("state", { ...state, since: "", calls }, (part) => {
    part.dataset.tone = state.tone;
    document.title = `${calls && !state.stale ? `(${calls}) ` : ""}${state.title} · AnyTraverse`;
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

// picture: the one that is shown; with it the ground from above where that is known.
export function showFromAbove({ frame, from_above }) {
  const part = document.getElementById("above");
  part.hidden = !from_above;
  if (from_above) part.querySelector("img").src = `/from_above.png?frame=${frame}`;
}

// lines: where the mount puts the ground in the picture.
export function showGround(lines) {
  metres.show(lines);
}

const fan = new Fan();
const drivable = new TimePlot("Drivable", { above: false, at: 1 });
const unexplained = new TimePlot("Unexplained", { above: true, at: 2 });
const caption = document.querySelector("#view figcaption");
caption.append(legend("look here"));
const metres = new Metres(document.getElementById("picture"), caption);
document.getElementById("ahead").append(fan.part, drivable.part, unexplained.part);
const [open, past] = ["open", "past"].map((id) => document.getElementById(id));
const pastTitle = past.firstElementChild;
let known = null, words = null, cards = null, lastMinute = null, bar = null; // until it is known whether the page may answer

// send: posts an answer; null where the page only shows.
export function begin(send) {
  known = new KnownPlace("h3", send && ((call) => send("answer", { motion: "none", changes: [{ other_place: call }] })), say);
  words = new Words("", send, () => cards.byKey.forEach((card) => card.refresh()));
  cards = new Cards(() => (send ? new AnswerCard("", send, say, words.staged, "h2") : new CallView()));
  document.getElementById("views").append(known.part);
  document.getElementById("words").append(words.part);
  bar = send && new AnswerBar(firstCard);
  lastMinute = send && new Incident(send, say);
  if (send) document.getElementById("log").before(lastMinute.part);
}

export const firstCard = watched(() => cards?.firstOpen);

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

// rover: {words, calls, names}, as cards and sliders want it.
export function showCalls(rover, time) {
  words.show({ ...rover, words_known: true });
  past.hidden = !cards.show(rover.calls, { front: open, past, before: [pastTitle] }, (card, call) => card.show(call, rover, time));
  bar?.show();
}

// data: what is shown of the incident files of the last minute.
export function showLastMinute(data) {
  lastMinute?.show("the last minute", { call: null }, data);
}

// What became of the newest answer that is on no card: words alone, for one.
export function showAlone(answers) {
  changed("alone", answers, (list) => list.replaceChildren(...answers.map(({ at, said, text, tone }) =>
    element("li", { tone }, element("time", {}, clock(at)), element("b", {}, ` From here: ${said}`), ` ${text}`))));
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
