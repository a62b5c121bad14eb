// Words for what the companion tells, and figures for a person. Pure.

export const STATES = {
  ok: { title: "OK", tone: "good", text: "The way ahead is known and drivable." },
  calling: { title: "CALLING", tone: "call", text: "It asks the operator." },
  holding: { title: "HOLDING", tone: "hold", text: "It holds the vehicle." },
  blocked: { title: "BLOCKED", tone: "blocked", text: "What is ahead is known and not drivable." },
  fault: { title: "FAULT", tone: "fault", text: "It cannot judge the way." },
  off: { title: "OFF", tone: "idle", text: "Switched off: nobody watches the way." },
  starting: { title: "STARTING", tone: "idle", text: "The perceiver is loading." },
};
export const POLICIES = {
  report: "report: it calls and holds nothing",
  shadow: "shadow: it calls, and counts what it would have held",
  hold: "hold: it may hold the vehicle",
  guide: "guide: it holds, and drives round what leaves room",
  off: "off: nobody watches the way",
};

export function duration(seconds) {
  const whole = Math.max(0, Math.floor(seconds));
  if (whole < 60) return `${whole} s`;
  if (whole < 3600) return `${Math.floor(whole / 60)} min ${whole % 60} s`;
  return `${Math.floor(whole / 3600)} h ${Math.floor((whole % 3600) / 60)} min`;
}

export const percent = (share) => (share == null ? "not known" : `${Math.round(100 * share)} %`);
export const capital = (text) => (text ? `${text[0].toUpperCase()}${text.slice(1)}` : "");
export const size = (bytes) => (bytes < 10_000 ? `${bytes} B` : bytes < 1e6 ? `${Math.round(bytes / 1000)} kB` : `${(bytes / 1e6).toFixed(1)} MB`);
export const clock = (seconds) => new Date(1000 * seconds).toLocaleTimeString("en-GB");
export const signed = (weight) => `${weight > 0 ? "+" : weight < 0 ? "−" : ""}${Math.abs(weight)}`;

export function weightText(weight) {
  if (weight === 0) return "0: not drivable";
  const strong = Math.abs(weight) === 1 ? "" : Math.abs(weight) >= 0.5 ? " rather" : " a little";
  return `${signed(weight)}:${strong} ${weight > 0 ? "drive over it" : "never drive over it"}`;
}
