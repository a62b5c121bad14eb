// Turns what the console tells into what a person reads. Pure: no page, no network, no clock.

import { titled } from "./calls.js";
import { POLICIES, STATES, capital, duration, percent, size } from "./wording.js";

const MOST_ENTRIES = 300;
const OLD = 3; // seconds after which what was heard is old

export const added = (known = [], fresh) => [...known, ...fresh].slice(-MOST_ENTRIES);

// How a rover is, in words and a tone.
export function state(rover, time) {
  if (!rover.up) {
    const silent = rover.heard === null ? "" : ` for ${duration(time - rover.heard)}`;
    return { title: "NOT HEARD", tone: "stale", text: `Nothing was heard of its companion${silent}. Nothing is sent to it until it is heard.` };
  }
  const known = STATES[rover.state] ?? { title: "UNKNOWN", tone: "stale", text: "This console does not know this state: update it." };
  if (rover.elsewhere) return { ...known, text: `The vehicle is held, not by the companion: ${rover.held_by || "its text says by whom"}.` };
  return known;
}

export function facts(rover, time) {
  const { link, ahead, vehicle } = rover;
  const age = rover.heard === null ? null : Math.max(0, time - rover.heard);
  return [
    ["mode", vehicle ? `${vehicle.mode}, ${vehicle.armed ? "armed" : "disarmed"}` : "no autopilot is heard on this link"],
    ["last heard", age === null ? "never" : age < OLD ? "just now" : `${duration(age)} ago`],
    ["loss", link.lost === null ? "not known" : `${percent(link.lost)} of summaries${link.dropped ? `, ${link.dropped} left out for want of budget` : ""}`],
    ["received", `${size(link.bytes)}${link.rate ? `, files at ${size(link.rate)} a second` : ""}`],
    ["picture", ahead ? `${ahead.frame_age} ms old when told` : ""],
    ["held by", rover.held_by],
    ["guiding", rover.guiding ? "it drives round something, in GUIDED" : ""],
    ["computer", rover.computer],
    ["shadow", rover.shadow],
    ["perceiver", rover.model],
    ["companion", rover.version],
  ].filter(([, text]) => text);
}

export const mode = ({ vehicle }) => (vehicle ? `${vehicle.mode}, ${vehicle.armed ? "armed" : "disarmed"}.` : "");

// Guide is for rovers that have all that it needs.
export const offered = (rover, policy) => policy !== "guide" || rover.offers_guide;

export const policyText = (policy) => POLICIES[policy] ?? policy;

// What the rover says is wrong, each with what to do.
export function faults(rover) {
  const found = rover.checks.map(({ check, verdict, text }) => ({ tone: verdict, title: check, text }));
  if (rover.hold_refused) found.unshift({ tone: "warn", title: "policy hold cannot be given", text: rover.hold_refused });
  if (rover.link.unreadable) found.unshift({ tone: "warn", title: "link", text: `${rover.link.unreadable} messages could not be read: update the older end` });
  if (rover.state === "fault" && rover.up) {
    const last = rover.texts.filter((one) => one.severity <= 4).at(-1);
    found.unshift({ tone: "fail", title: "fault", text: `${last ? `It says "${last.text}". ` : ""}Look at its camera and computer; drive by hand until it is gone.` });
  }
  return found;
}

export function summary(rovers, connection, time) {
  if (connection) return { title: "NO CONNECTION", tone: "stale", text: connection, calls: 0 };
  const open = rovers.flatMap((rover) => rover.calls.filter((call) => call.open).map((call) => ({ rover, call })));
  if (open.length) {
    const [{ rover, call }] = open;
    const who = rovers.length > 1 ? `Rover ${rover.system}: ` : "";
    const more = open.length > 1 ? ` ${open.length} calls are open.` : "";
    const hold = call.kind === "hold";
    return { title: hold ? "HOLDING" : "CALLING", tone: hold ? "hold" : "call", text: `${who || `${mode(rover)} `}${titled(call)}: ${call.reason}${more}`, calls: open.length };
  }
  if (!rovers.length) return { title: "AnyTraverse console", tone: "idle", text: "No rover is heard yet.", calls: 0 };
  const worst = state(rovers[0], time);
  const lost = rovers.filter((one) => !one.up).length;
  const heard = lost && rovers.length > 1 ? `${lost} of ${rovers.length} rovers not heard.` : rovers.length > 1 ? `${rovers.length} rovers are heard, none calls.` : `${worst.text} ${mode(rovers[0])}`;
  return { title: worst.title, tone: worst.tone, text: heard, calls: 0 };
}

const METRES = 111320; // of a degree of latitude
const LEAST = 20; // metres across that are shown at least

// How places [latitude, longitude] come into a picture of width x height that shows them all, north up.
// Returns at: place -> [x, y], and metres: how many of its pixels are a metre.
export function surroundings(places, width, height) {
  const [lat, lon] = places[0];
  const east = (place) => ((((place[1] - lon + 540) % 360) + 360) % 360 - 180) * METRES * Math.cos((lat * Math.PI) / 180);
  const north = (place) => (place[0] - lat) * METRES;
  const range = (values) => [Math.min(...values), Math.max(...values)];
  const [west, far] = range(places.map(east)), [south, top] = range(places.map(north));
  const metres = 0.76 * Math.min(width / Math.max(LEAST, far - west), height / Math.max(LEAST, top - south));
  const at = (place) => [width / 2 + (east(place) - (west + far) / 2) * metres, height / 2 - (north(place) - (south + top) / 2) * metres];
  return { at, metres };
}

// The largest of 1, 2, 5, 10, 20... that is at most so much.
export function nice(most) {
  const tens = 10 ** Math.floor(Math.log10(most));
  return tens * [5, 2, 1].find((one) => one * tens <= most);
}
