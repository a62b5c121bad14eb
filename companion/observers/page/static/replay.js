// Shows one recording: a strip to scrub through, and the picture, maps, state and calls of one moment together.

import { changed, drawn, element, showFacts, showText } from "./elements.js";
import { draw, unpacked } from "./judgement.js";
import { RecordingFile } from "./recording_file.js";
import { duration } from "./wording.js";
import { PATIENCE } from "./stream.js";
import { eventText, facts, rowNote, rowTitle, seconds } from "./recorded.js";

const THUMBNAILS = 10, JUMP = 10_000; // ms

export class Replay {
  // send: posts what is asked, null where the page only shows. closed: called when it is to be closed.
  constructor(send, say, closed) {
    this.wanted = this.moment = this.shown = null;
    this.loading = false;
    this.title = element("h3", { id: "replay-title", tabIndex: -1 });
    this.note = element("p", { className: "first" });
    this.canvas = element("canvas", { width: 320, height: 240, role: "img", "aria-label": "No picture yet" });
    this.missing = element("p", { className: "note" });
    this.judged = element("input", { type: "checkbox", checked: true, onchange: () => this.draw() });
    this.strip = element("div", { className: "strip", "aria-hidden": "true" });
    this.slider = element("input", { type: "range", min: 0, max: 0, step: 1, value: 0, "aria-label": "Moment of the recording", oninput: () => this.want(Number(this.slider.value)) });
    this.marks = drawn("svg", { viewBox: "0 0 1000 8", preserveAspectRatio: "none", "aria-hidden": "true", class: "marks" });
    this.facts = element("dl", { className: "facts" });
    this.events = element("ul", { className: "events" });
    this.previous = button("Frame before", () => this.step("previous"));
    this.next = button("Frame after", () => this.step("next"));
    this.file = send && new RecordingFile(send, say);
    const close = button("Close", closed);
    this.part = element("div", { className: "replay", role: "group", "aria-labelledby": "replay-title" },
      element("div", { className: "replay-head" }, this.title, close), this.note,
      element("div", { className: "replay-view" },
        element("div", {},
          element("div", { className: "frame pane" }, this.canvas, this.missing),
          element("div", { className: "scrub" }, this.strip, this.marks, this.slider),
          element("div", { className: "under" }, this.previous, this.next, element("label", { className: "fade" }, this.judged, "How it was judged")),
          element("p", { className: "faint" }, "Arrow keys go from frame to frame, with shift 10 s; Home and End to its ends.")),
        element("div", {}, this.facts, this.events, this.file?.part ?? "")));
    this.part.addEventListener("keydown", (event) => this.pressed(event));
    for (const kind of ["pointerdown", "pointermove"]) this.strip.addEventListener(kind, (event) => this.dragged(event));
  }

  get length() {
    return Math.max(0, Math.round(1000 * (this.row.seconds ?? 0)));
  }

  // row: as /recordings.json tells it.
  show(row) {
    const first = this.row?.number !== row.number;
    this.row = row;
    showText(this.title, `${rowTitle(row)}${row.begin ? `, ${duration(row.seconds)}` : ""}`);
    showText(this.note, rowNote(row));
    this.slider.max = this.length;
    this.slider.disabled = !row.frames;
    this.file?.show(row);
    changed(this.marks, [row.events, this.length], (marks) => marks.replaceChildren(...(row.events ?? []).map(({ at, what }) => {
      const x = (1000 * at) / (this.length || 1);
      return drawn("line", { x1: x, x2: x, y1: 0, y2: 8, class: what === "fault" ? "fault" : "call-mark" });
    })));
    changed(this.events, row.events, (list) => list.replaceChildren(...(row.events ?? []).map((event) =>
      element("li", {}, button(`${seconds(event.at)}: ${eventText(event)}`, () => this.want(event.at), "chip")))));
    if (!first) return;
    this.moment = this.shown = this.wanted = null;
    this.previous.disabled = this.next.disabled = true;
    Object.assign(this.canvas, { width: 320, height: 240 });
    showFacts(this.facts, []);
    showText(this.missing, row.frames ? "" : "There is no picture in it.");
    const times = row.frames ? Array.from({ length: THUMBNAILS }, (_, at) => Math.round((this.length * (at + 0.5)) / THUMBNAILS)) : [];
    this.strip.replaceChildren(...times.map((at) => element("img", { src: frameUrl(row, at), alt: "", loading: "lazy", draggable: false, onerror: ({ target }) => target.classList.add("gone") })));
    if (row.begin) this.want(row.events?.find(({ id }) => id)?.at ?? 0);
  }

  pressed(event) {
    const far = event.shiftKey ? JUMP : 0;
    const act = {
      ArrowLeft: () => (far ? this.want(this.at - far) : this.step("previous")),
      ArrowRight: () => (far ? this.want(this.at + far) : this.step("next")),
      Home: () => this.want(0),
      End: () => this.want(this.length),
    }[event.key];
    if (!act || event.ctrlKey || event.altKey || event.metaKey) return;
    event.preventDefault();
    act();
  }

  dragged(event) {
    if (event.type === "pointermove" && !event.buttons) return;
    if (event.type === "pointerdown") this.strip.setPointerCapture(event.pointerId);
    const box = this.strip.getBoundingClientRect();
    this.want(Math.round(this.length * ((event.clientX - box.left) / box.width)));
  }

  get at() {
    return this.wanted ?? this.moment?.at ?? 0;
  }

  step(which) {
    if (this.wanted === null && this.moment?.[which] != null) this.want(this.moment[which]);
  }

  // Shows the moment once the one before has come: no more than one is on its way.
  async want(at) {
    this.wanted = Math.min(Math.max(0, at), this.length);
    this.slider.value = this.wanted;
    if (this.loading) return;
    this.loading = true;
    while (this.wanted !== null) {
      const [asked, row] = [this.wanted, this.row];
      const problem = await this.load(row, asked);
      if (row !== this.row && row.number !== this.row.number) continue;
      if (problem) showText(this.missing, problem);
      if (this.wanted === asked) this.wanted = null;
    }
    this.loading = false;
  }

  // Returns "", or why it is not shown.
  async load(row, at) {
    try {
      const answer = await fetch(`/recordings/${row.number}/moment.json?at=${at}`, { signal: AbortSignal.timeout(PATIENCE) });
      if (!answer.ok) return answer.status === 404 ? "Nothing of it can be read, or it is gone." : `It did not come: ${(await answer.text()).trim()}.`;
      const moment = await answer.json();
      const [picture, traversability, uncertainty] = await Promise.all([
        unpacked(moment.picture, "image/jpeg"), unpacked(moment.traversability, "image/png"), unpacked(moment.uncertainty, "image/png")]);
      if (row.number !== this.row.number) return "";
      this.moment = moment;
      this.shown = picture && { picture, traversability, uncertainty, outlines: moment.outlines };
      if (this.wanted === at) this.slider.value = moment.at;
      this.draw();
      return picture ? "" : "There is no picture at that moment.";
    } catch (error) {
      return error instanceof DOMException && error.name === "InvalidStateError" ? "The picture cannot be decoded." : "It did not come: the rover does not answer.";
    }
  }

  draw() {
    const { moment } = this;
    if (!moment) return;
    if (this.shown) draw(this.canvas, this.shown, this.judged.checked);
    showText(this.missing, "");
    const rows = facts(moment, this.length);
    showFacts(this.facts, rows);
    const told = `${seconds(moment.at)} of ${seconds(this.length)}, ${moment.state}`;
    this.slider.setAttribute("aria-valuetext", told);
    this.canvas.setAttribute("aria-label", `What the rover saw after ${told}`);
    this.previous.disabled = moment.previous === null;
    this.next.disabled = moment.next === null;
  }
}

export const frameUrl = ({ number }, at) => `/recordings/${number}/frame.jpg?at=${at}`;

function button(text, onclick, className = "plain") {
  return element("button", { type: "button", className, onclick }, text);
}
