// Turns what is told of recordings into what a person reads. Pure: no page, no network, no clock.

import { STATES, capital, clock, duration, percent, signed, size } from "./wording.js";

const when = (seconds) => new Date(1000 * seconds).toLocaleString("en-GB", { dateStyle: "medium", timeStyle: "medium" });
const spaced = (text) => text.replaceAll("_", " ");
export const named = ({ number }) => `recording ${String(number).padStart(6, "0")}`;

// A moment's place in its recording, ms as seconds.
export const seconds = (ms) => `${(ms / 1000).toFixed(1)} s`;

// told: what the companion says of recording, {} before it has.
export function overview({ on, files = 0, bytes = 0, trouble = "" }) {
  const there = files === 1 ? "One recording" : `${files || "No"} recordings`;
  return `${there}${files ? `, ${size(bytes)}` : ""}. ${on ? "It is recording." : on === undefined ? "" : `Nothing is recorded: ${trouble || "the recorder starts"}.`}`;
}

export function rowTitle(row) {
  return row.begin ? when(row.begin) : capital(named(row));
}

export function rowText(row) {
  const parts = [row.begin && duration(row.seconds), size(row.bytes), row.frames && `${row.frames} pictures`];
  return parts.filter(Boolean).join(", ");
}

// What is unusual about it, or "".
export function rowNote(row) {
  if (row.unread) return "It is being looked up.";
  if (row.writing) return "It is being written.";
  return row.trouble ? `${capital(row.trouble)}.` : "";
}

export function eventText({ what, id }) {
  const name = `${what.includes("hold") ? "H" : "C"}${id}`;
  return id ? `${name} ${what.replace(/^(call|hold) /, "")}` : what;
}

// The calls and holds in it, each once, and whether a fault began.
export function rowEvents({ events = [], more }) {
  const held = new Set(events.filter(({ what, id }) => id && what === "hold started").map(({ id }) => id));
  const calls = [...new Set(events.filter(({ id }) => id).map(({ id }) => id))].map((id) => (held.has(id) ? `H${id}` : `C${id}`));
  const faults = events.some(({ what }) => what === "fault") ? ["fault"] : [];
  return [...calls, ...faults, ...(more ? ["and more"] : [])];
}

// moment: as /recordings/N/moment.json tells it.
export function facts(moment, length) {
  const { judged, open, speed, place, armed, words = {} } = moment;
  const state = STATES[moment.state];
  const reasons = [...new Set([...(moment.reasons ?? []), ...(judged?.reasons ?? [])])].map(spaced);
  const tenths = Math.floor(10 * (moment.time % 1));
  const rows = [
    ["time", `${clock(moment.time)}.${tenths}, ${seconds(moment.at)} of ${seconds(length)}`],
    ["state", state ? `${state.title}: ${state.text}` : moment.state],
    ["open", open ? `${moment.kind} ${open}, ${moment.stage}, ${moment.holding ? "vehicle held" : "vehicle not held"}` : "no call, no hold"],
    ["reasons", reasons.join(", ") || "none"],
    ["drivable", judged && percent(judged.drivable_share)],
    ["uncertainty", judged && `${percent(judged.uncertainty)}${judged.tile === null ? "" : `, worst tile ${percent(judged.tile)}`}`],
    ["similarity", judged && (judged.similarity === null ? "not known" : judged.similarity.toFixed(2))],
    ["vehicle", [speed === null ? "" : `${speed.toFixed(1)} m/s`, armed === null ? "" : armed ? "armed" : "disarmed", place ? place.map((one) => one.toFixed(5)).join(", ") : ""].filter(Boolean).join(", ")],
    ["policy", moment.policy],
    ["words", Object.entries(words).map(([word, weight]) => `${word} ${signed(weight)}`).join(", ")],
  ];
  return rows.filter(([, text]) => text);
}
