// Connects the stream of events with the cards of a drive's calls.

import { AnswerCard } from "./answer_card.js";
import { Untold, aloud } from "./calls.js";
import { Cards } from "./cards.js";
import { element, showText } from "./elements.js";
import { listenToKeys } from "./keys.js";
import { poster, say } from "./sending.js";
import { Stream, whyNot } from "./stream.js";
import { Words } from "./words.js";

const now = () => performance.now() / 1000;
const part = (id) => document.getElementById(id);
const send = poster("the rehearsal does not answer. Does it still run?");
let told = null;
let connection = "";
let offset = 0; // this clock less the rehearsal's
const untold = new Untold();

// A call that can also be left to the rover.
class RehearsalCard extends AnswerCard {
  constructor() {
    super("", send, say, words.staged, "h2");
    this.skip = element("button", { type: "button", className: "plain", onclick: async () => showText(this.problem, await send("skip", {})) }, "Skip: let the rover ask on its drive");
    this.problem.before(this.skip);
  }

  show(data, rover, time) {
    super.show(data, rover, time);
    this.skip.hidden = !data.open;
  }
}

const words = new Words("", send, () => cards.byKey.forEach((card) => card.refresh()));
const cards = new Cards(() => new RehearsalCard());
part("words").append(words.part);
const pastTitle = part("past").firstElementChild;

function show() {
  const over = told?.state === "over";
  const lost = connection && !over;
  document.body.classList.toggle("stale", Boolean(lost));
  const { title, tone, text } = lost ? { title: "NO CONNECTION", tone: "stale", text: connection } : summary(told);
  part("top").dataset.tone = tone;
  showText("title", title);
  showText("summary", text);
  document.title = `${title} · AnyTraverse rehearsal`;
  if (!told) return;
  const rover = { ...told, words_known: true };
  words.show({ ...rover, calls: [{ open: true }] }); // what is changed always goes with the next answer
  part("past").hidden = !cards.show(told.calls, { front: part("open"), past: part("past"), before: [pastTitle] }, (card, call) => card.show(call, rover, now() - offset));
  part("waiting").hidden = over || part("open").childElementCount > 0;
  part("end").hidden = over || Boolean(lost);
  Object.assign(part("progress"), { max: Math.max(told.count, told.frame, 1), value: told.frame });
  for (const call of untold.take(told.calls)) say(aloud({ ...call, stands: "" }));
}

// What stands at the top, in words and a tone.
function summary(news) {
  if (!news) return { title: "AnyTraverse rehearsal", tone: "idle", text: "Waiting for the drive." };
  const far = `${news.frame} of ${news.count} frames, ${news.asked} ${news.asked === 1 ? "call" : "calls"}, ${news.answered} answered.`;
  return {
    asking: { title: "CALLING", tone: "call", text: `The drive waits for your answer. ${far}` },
    judging: { title: "JUDGING", tone: "good", text: `Your answer is judged. ${far}` },
    playing: { title: "DRIVING", tone: "good", text: `${news.title}: ${far}` },
    over: { title: "OVER", tone: "idle", text: `${news.title}: ${far} The terminal says where the results are; this page can be closed.` },
  }[news.state];
}

new Stream(["news"], (kind, content, late) => {
  if (kind === "connection") connection = content;
  else {
    told = content;
    offset = now() - late - content.clock;
  }
  show();
}, whyNot("/", {
  token: "The page wants its token: open the address again that the terminal shows.",
  refused: "The rehearsal answers, but refuses the stream: close other pages like this one.",
  gone: "The rehearsal does not run any more. What was answered is in its folder.",
}), { whileHidden: true });

part("end").addEventListener("click", () => send("end", {}));
part("about").textContent = "What you answer is remembered for the rover. Stay and look again teach nothing here. Esc takes back what is not sent.";
part("about").before(listenToKeys(() => cards.firstOpen));
setInterval(show, 500);
