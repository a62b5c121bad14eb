// Turns what the companion tells into what a person reads. Pure: no page, no network, no clock.

import { POLICIES, STATES, capital, duration, percent } from "./wording.js";

const NEWS_FRESH = 3; // seconds; the companion tells something once a second
const PICTURE_FRESH = 3;
const CHECKS_FRESH = 60; // the companion checks itself every ten seconds

// news: the newest event with `receivedAt` added, or null. now, receivedAt: seconds of one clock.
// connection: "" or why there is none.
export function overview(news, now, connection) {
  const silent = news === null ? null : (news.age ?? Infinity) + now - news.receivedAt;
  if (silent === null || !(silent <= NEWS_FRESH)) {
    const never = silent === null || silent === Infinity;
    const what = never ? "The companion has told nothing yet." : "No news from the companion: nothing below is live.";
    return {
      title: "NO NEWS",
      tone: "stale",
      why: [what, connection].filter(Boolean).join(" "), // read aloud when it changes, so without seconds
      since: never ? "" : `for ${duration(silent)}`,
      stale: true,
    };
  }
  const status = news.status ?? {};
  const state = STATES[status.state] ??
    { title: String(status.state ?? "UNKNOWN").toUpperCase(), tone: "stale", text: "This page does not know this state." };
  const reasons = (status.reasons ?? []).map((one) => one.replaceAll("_", " "));
  const seconds = news.since + now - news.receivedAt;
  return {
    title: state.title,
    tone: state.tone,
    why: [state.text, capital(news.told || reasons.join(", "))].filter(Boolean).join(" "),
    since: `for ${news.exact ? "" : "at least "}${duration(seconds)}`,
    stale: false,
  };
}

// picture: {frame, age, receivedAt}, or null.
export function pictureNote(picture, now, stale) {
  if (picture === null) return { text: "No picture yet: it is drawn while somebody watches.", fresh: false };
  const age = picture.age + now - picture.receivedAt;
  if (age <= PICTURE_FRESH && !stale) return { text: "", fresh: true };
  return { text: `Not live: this picture is ${duration(age)} old.`, fresh: false };
}

// What was not told is left out: while the companion starts, nothing of it is known.
export function facts({ status = {}, state = {} }) {
  const { camera = {}, judging = {}, perceiver = {}, vision, link } = status;
  const { open } = state;
  const rows = [
    ["policy", status.policy && (POLICIES[status.policy] ?? status.policy) + (status.hold_refused ? `. ${status.hold_refused}` : "")],
    ["guide", status.policy === "guide" && status.guide && [status.guide.state, status.guide.lacks].filter(Boolean).join(": ")],
    ["open", open === undefined ? "" : open ? openText(open) : "no call, no hold"],
    ["held by", status.held_by === null ? "nobody" : status.held_by],
    ["uncertainty", percent(status.roi_uncertainty)],
    ["similarity", status.similarity == null ? "not known" : status.similarity.toFixed(2)],
    ["camera", [camera.state, camera.reason, camera.width ? `${camera.width} × ${camera.height}` : "",
      camera.rate == null ? "" : `${camera.rate.toFixed(1)} a second`,
      camera.infrared ? "shows infrared (NoIR)" : ""].filter(Boolean).join(", ")],
    ["latency", status.latency_ms == null ? "not known" : `${Math.round(status.latency_ms)} ms from capture until judged`],
    ["judging", judging.rate == null ? "" : `${judging.rate} of ${judging.configured} a second${judging.lowered_by ? `: ${judging.lowered_by}` : ""}`],
    ["perceiver", [perceiver.model, perceiver.precision].filter(Boolean).join(", ")],
    ["vision", vision && (vision.trouble || (vision.restarts ? `running, started again ${vision.restarts} ×` : "running"))],
    ["link", link && (link.trouble || (link.autopilot ? `autopilot heard on ${link.autopilot}` : "no autopilot is heard"))],
  ];
  return rows.filter(([, text]) => text);
}

export function computer({ status = {}, check = {} }) {
  const { computer: told = {}, disk = {} } = status;
  const known = (value, text) => (value == null ? "not told" : text(value));
  const room = (free, all) => known(free, (value) => `${gib(value)} of ${gib(all)} free`);
  return [
    ["temperature", known(told.temperature, (value) => `${value.toFixed(0)} °C`) + (told.throttled ? ", slowed down" : "")],
    ["supply", told.under_voltage == null ? "not told" : told.under_voltage ? "voltage too low" : "good"],
    ["CPU", known(told.cpu, percent)],
    ["memory", room(told.memory_free, told.memory)],
    ["disk", room(told.disk_free, told.disk) + (disk.failing ? ", writes fail" : "")],
    ["page", status.web?.restarts ? `started again ${status.web.restarts} ×` : "running"],
    ...(check.age > CHECKS_FRESH ? [["measured", "more than a minute ago: the disk may hang"]] : []),
  ];
}

// The words in force, and those that have a parameter, as the operator's console has them.
export function words({ state = {} }) {
  const { words: used = {}, vocabulary = [] } = state;
  const shown = Object.entries(used).sort(([, a], [, b]) => b - a);
  return [...shown, ...vocabulary.filter((word) => !(word in used)).map((word) => [word, null])]
    .map(([word, weight]) => ({ word, weight, fixed: vocabulary.includes(word) }));
}

export function checks({ check = {} }) {
  if (!Array.isArray(check.checks)) return { summary: "The first check has not been made yet.", rows: [] };
  const bad = check.checks.filter((row) => row.verdict === "fail" || row.verdict === "warn");
  if (!((check.age ?? Infinity) <= CHECKS_FRESH))
    return { summary: "These checks are more than a minute old: the disk may hang. What they say may not be so any more.", rows: check.checks };
  return {
    summary: bad.length ? `${bad.length} of ${check.checks.length} want a look; mend them from the top.` : "All is well.",
    rows: check.checks,
  };
}

export function logLines(text) {
  return text.split("\n").map((line) => ({
    line,
    tone: /^\S+ \S+ (ERROR|CRITICAL) /.test(line) ? "bad" : /^\S+ \S+ WARNING /.test(line) ? "warn" : "",
  }));
}

function openText(open) {
  const kind = open.kind === "hold" ? "hold" : "call";
  return `${kind} ${open.id}, ${open.stage}, ${open.holding ? "vehicle held" : "vehicle not held"}`;
}

const gib = (mebibytes) => (mebibytes < 1024 ? `${mebibytes} MiB` : `${(mebibytes / 1024).toFixed(1)} GiB`);
