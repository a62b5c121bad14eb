// Connects the stream of events with the sections of the rovers, and keys with the first call.

import { arrange, element, showText } from "./elements.js";
import { Stream, whyNot } from "./stream.js";
import { Alarm } from "./alarm.js";
import { AnswerBar } from "./bar.js";
import { Untold, aloud } from "./calls.js";
import { watched } from "./cards.js";
import { leaveEmptyField, listenToKeys } from "./keys.js";
import * as model from "./model.js";
import { joined } from "./plots.js";
import { RoverView } from "./rover.js";
import { poster, say } from "./sending.js";

const now = () => performance.now() / 1000;
const rovers = new Map(); // system -> RoverView
const points = new Map();
const entries = new Map();
const tracks = new Map();
const untold = new Untold();
const alarm = new Alarm(document.getElementById("alarm"));
let news = null;
let connection = "";
let offset = 0; // this clock less the console's

const firstCard = watched(() => news?.rovers.map((one) => view(one.system).cards.firstOpen).find(Boolean));
const bar = new AnswerBar(firstCard, (card) => (news.rovers.length > 1 ? `Rover ${card.system}, ` : ""));

const send = poster("the console does not answer. Is it still running?");

function view(system) {
  if (!rovers.has(system)) {
    const made = new RoverView(system, send, say);
    rovers.set(system, made);
  }
  return rovers.get(system);
}

function show() {
  const time = now() - offset;
  const stale = connection !== "";
  document.body.classList.toggle("stale", stale);
  const shown = news?.rovers ?? [];
  document.getElementById("nobody").hidden = shown.length > 0;
  if (news) showText("nobody-why", news.problems[0] ?? `Listening on ${news.links.join(", ")}.`);
  const main = document.getElementById("rovers");
  for (const [system, gone] of rovers) {
    if (shown.some((one) => one.system === system)) continue;
    gone.part.remove();
    [rovers, points, entries, tracks].forEach((one) => one.delete(system));
  }
  arrange(main, shown.map((one) => view(one.system).part), 1);
  main.classList.toggle("several", shown.length > 1);
  for (const one of shown) {
    view(one.system).show(one, { points: points.get(one.system) ?? [], entries: entries.get(one.system) ?? [], track: tracks.get(one.system) ?? [], corners: news.background, time, several: shown.length > 1 });
  }
  const top = model.summary(shown, connection, time);
  document.getElementById("top").dataset.tone = top.tone;
  showText("title", top.title);
  showText("summary", top.text);
  bar.show();
  document.title = top.calls ? `(${top.calls}) ${top.title} · AnyTraverse` : "AnyTraverse console";
  const problems = stale ? [connection] : news?.problems ?? [];
  const list = document.getElementById("problems");
  if (list.textContent !== problems.join("")) list.replaceChildren(...problems.map((text) => element("li", {}, text)));
  if (news) showText("about", `AnyTraverse companion ${news.version}. Listening on ${news.links.join(", ")}.${news.doubled ? ` ${news.doubled} signed messages came over two links, and counted once.` : ""}`);
}

function tell() {
  for (const { system, calls } of news.rovers) {
    for (const call of untold.take(calls, system)) {
      const text = `${news.rovers.length > 1 ? `Rover ${system} calls. ` : ""}${aloud(call)}`;
      say(text);
      alarm.ring(text, `${system}/${call.key}`);
      leaveEmptyField();
    }
  }
}

new Stream(["fresh", "news", "points", "timeline", "track"], (kind, content, late) => {
  if (kind === "connection") {
    if (connection === content) return;
    connection = content;
  } else {
    offset = now() - late - content.clock;
    if (kind === "fresh") [points, entries, tracks].forEach((one) => one.clear());
    if (kind === "points") points.set(content.system, joined(points.get(content.system), content.points));
    if (kind === "track") tracks.set(content.system, content.points);
    if (kind === "timeline") entries.set(content.system, model.added(entries.get(content.system), content.entries));
    if (kind !== "news") return;
    news = content;
    tell();
  }
  show();
}, whyNot("/", {
  token: "The console wants its token: open it again with ?token=...",
  refused: "The console answers, but refuses the stream: close other pages like this one.",
  gone: "No connection to the console: nothing here is live. Start anytraverse-console again; this page connects by itself.",
}), { whileHidden: true });

document.getElementById("about").before(listenToKeys(firstCard));

setInterval(show, 500);
