// Shows one page after the other, and what is done.

import { AutopilotPage } from "./autopilot.js";
import { CameraPage } from "./camera.js";
import { changed, element, showText } from "./elements.js";
import { LinkPage } from "./link.js";
import { Live } from "./live.js";
import { MountPage } from "./mount.js";
import { button } from "./parts.js";
import { PolicyPage } from "./policy.js";
import { RegionPage } from "./region.js";
import { ReviewPage } from "./review.js";
import { SettingsPage } from "./all_settings.js";
import { Store } from "./store.js";
import { VehiclePage } from "./vehicle.js";
import { WordPage } from "./word_page.js";

const PAGES = [
  ["camera", "Camera", CameraPage], ["mount", "Mount", MountPage], ["vehicle", "Vehicle", VehiclePage], ["region", "Region", RegionPage], ["words", "Words", WordPage],
  ["link", "Link", LinkPage], ["autopilot", "Autopilot", AutopilotPage], ["policy", "Policy", PolicyPage], ["review", "Review", ReviewPage], ["settings", "All settings", SettingsPage],
];
const store = new Store();
const live = new Live();
const home = document.getElementById("page");
const pages = new Map();
let current = null;

const named = () => PAGES.find(([name]) => `#${name}` === location.hash) ?? PAGES[0];

function go([name, title, Kind]) {
  pages.get(current)?.leave?.();
  if (!pages.has(name)) pages.set(name, new Kind(store, live));
  current = name;
  const page = pages.get(name);
  const at = PAGES.findIndex(([one]) => one === name);
  const before = PAGES[at - 1], after = at < 8 ? PAGES[at + 1] : null;
  const way = element("div", { className: "way" },
    before && at < 9 ? button(`Back: ${before[1]}`, () => (location.hash = before[0])) : "",
    after ? button(`Next: ${after[1]}`, () => (location.hash = after[0]), { className: "primary" }) : at === 9 ? button("Review", () => (location.hash = "review"), { className: "primary" }) : "");
  home.replaceChildren(page.part, way);
  document.title = `${title} · AnyTraverse set-up`;
  page.show(store.state);
  page.enter?.();
  steps();
  scrollTo(0, 0);
}

function steps() {
  const told = PAGES.map(([name, title]) => [name, title, name === current, Boolean(pages.get(name)?.done?.(store.state))]);
  changed("steps", told, (nav) => nav.replaceChildren(element("ol", {}, ...told.map(([name, title, here, done]) =>
    element("li", {}, element("a", { href: `#${name}`, className: done ? "done" : "", ...(here ? { "aria-current": "page" } : {}) }, done ? `✓ ${title}` : title, done ? element("span", { className: "unseen" }, ", done") : ""))))));
}

function summary({ file, changed: keys, running }) {
  const refused = [...store.refused.keys()].join(", ");
  const told = [keys.length ? `${keys.length} changed, not written` : "", refused ? `not taken: ${refused}` : ""].filter(Boolean).join("; ");
  showText("summary", `${running || file}${told ? `: ${told}` : ""}`);
  document.getElementById("top").dataset.tone = running ? "call" : keys.length ? "hold" : "idle";
}

store.listeners.push(summary, (state) => { pages.get(current)?.show(state); steps(); });
addEventListener("hashchange", () => { go(named()); home.querySelector("h2")?.setAttribute("tabindex", "-1"); home.querySelector("h2")?.focus({ preventScroll: true }); });
setInterval(() => store.state && (steps(), summary(store.state)), 1000);
document.addEventListener("visibilitychange", () => document.hidden || !store.state || store.load()); // another tab may have changed it
const wrong = await store.load();
if (wrong) showText("summary", wrong);
else go(named());
