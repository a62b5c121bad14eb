// One rover: its state, the call that is open, what is ahead, words, link, faults, earlier calls, timeline.

import { arrange, changed, element, showFacts, showText } from "./elements.js";
import * as model from "./model.js";
import { CallCard } from "./call.js";
import { KnownPlace } from "./place.js";
import { Fan, TimePlot } from "./plots.js";
import { Track } from "./track.js";
import { Words } from "./words.js";
import { clock } from "./wording.js";

const POLICIES = ["report", "shadow", "hold", "off"];

export class RoverView {
  constructor(system, send, say) {
    Object.assign(this, { system, send, say });
    this.cards = new Map();
    this.name = element("h2", { id: `rover${system}` });
    this.title = element("strong");
    this.text = element("span");
    this.strip = element("header", { className: "strip" }, this.name, this.title, this.text);
    this.open = element("div", { className: "open" });
    this.traversability = new TimePlot("Drivable", { above: false, at: 1 });
    this.uncertainty = new TimePlot("Unexplained", { above: true, at: 2 });
    this.fan = new Fan();
    this.words = new Words(system, send, () => this.refreshCards());
    this.place = new KnownPlace("h4", (call) => send("answer", { rover: system, motion: "none", changes: [{ other_place: call }] }));
    this.track = new Track((key) => this.cards.get(key)?.look());
    this.policy = element("div", { className: "policies", role: "group", "aria-label": "Policy" });
    this.policyText = element("p", { className: "faint" });
    this.facts = element("dl", { className: "facts" });
    this.faults = element("ul", { className: "faults" });
    this.check = element("button", { type: "button", className: "plain", onclick: () => send("fetch", { rover: system, what: "check" }) }, "Ask it what is wrong");
    this.past = element("div", { className: "past" });
    this.pastTitle = element("h3", {}, "Earlier calls");
    this.more = element("button", { type: "button", className: "plain", onclick: () => send("fetch", { rover: system, what: "calls" }) });
    this.saveAll = element("a", { className: "save", href: `/export/${system}/all.zip`, download: "" }, "Save all calls as one report");
    this.timeline = element("ol", { className: "timeline", tabIndex: 0, "aria-label": "Timeline" });
    const box = (title, ...parts) => element("section", {}, element("h3", {}, title), ...parts);
    this.part = element("article", { className: "rover", "aria-labelledby": `rover${system}` }, this.strip, this.open,
      element("div", { className: "panels" },
        box("Ahead", this.fan.part, this.traversability.part, this.uncertainty.part, this.place.part),
        this.tracked = box("Track", this.track.part),
        box("Words", this.words.part),
        box("Policy", this.policy, this.policyText),
        box("What is wrong", this.faults, this.check),
        box("Rover and link", this.facts),
        box("Timeline", this.timeline)),
      this.past);
    this.policy.append(...POLICIES.map((policy) => element("button", { type: "button", value: policy, onclick: () => send("policy", { rover: system, policy }) }, policy)));
  }

  show(rover, { points, entries, track, corners, time, several }) {
    const state = model.state(rover, time);
    this.part.dataset.tone = state.tone;
    this.part.classList.toggle("silent", !rover.up);
    this.strip.classList.toggle("unseen", !several);
    showText(this.name, `Rover ${rover.system}`);
    showText(this.title, state.title);
    showText(this.text, `${state.text} ${model.mode(rover)}`);
    this.showCalls(rover, time);
    this.fan.show(rover.ahead);
    this.traversability.show(points, rover.thresholds.trav, time);
    this.uncertainty.show(points, rover.thresholds.unc, time);
    this.tracked.hidden = !this.track.show(track, rover.position, rover.calls, corners);
    this.words.show(rover);
    this.place.show(rover.known_place);
    for (const button of this.policy.children) button.setAttribute("aria-pressed", String(button.value === rover.policy));
    showText(this.policyText, rover.policy ? model.policyText(rover.policy) : "Its policy is not known yet.");
    showFacts(this.facts, model.facts(rover, time));
    this.showFaults(rover);
    changed(this.timeline, entries.at(-1)?.n ?? 0, (list) => list.replaceChildren(...entries.slice(-100).reverse().map(({ at, tone, text }) =>
      element("li", { tone }, element("time", {}, clock(at)), ` ${text}`))));
  }

  showCalls(rover, time) {
    const wanted = new Map(rover.calls.map((call) => [call.key, call]));
    for (const [key, card] of this.cards) {
      if (wanted.has(key)) continue;
      card.part.remove();
      this.cards.delete(key);
    }
    const inFront = [], behind = [];
    const latest = rover.calls.find((call) => !call.open);
    for (const call of rover.calls) {
      if (!this.cards.has(call.key)) {
        const card = new CallCard(rover.system, this.send, this.say, this.words.staged, performance.now() / 1000, () => this.showChosen());
        card.replaces = [...this.cards.values()].some((other) => other.data?.open || performance.now() / 1000 - (other.closedAt ?? -Infinity) < 5);
        this.cards.set(call.key, card);
      }
      const card = this.cards.get(call.key);
      if (card.data?.open && !call.open) card.closedAt = performance.now() / 1000;
      card.show(call, rover, time);
      // A call stays in front until another is there, so that what became of it is seen.
      const front = call.open || (call === latest && !rover.calls.some((one) => one.open) && (card.closedAt ?? -Infinity) > performance.now() / 1000 - 60);
      (front ? inFront : behind).push(card.part);
    }
    arrange(this.open, inFront);
    arrange(this.past, [this.pastTitle, ...behind, this.saveAll, this.more]);
    this.past.hidden = !behind.length && rover.earlier === "known" && this.cards.size < 2;
    this.showChosen();
    this.more.hidden = rover.earlier === "known";
    this.more.disabled = rover.earlier === "coming";
    showText(this.more, rover.earlier === "coming" ? "Earlier calls are on their way" : "Fetch the calls before this console began");
  }

  // The report is of the calls that are chosen, or of all.
  showChosen() {
    const chosen = [...this.cards.values()].filter((card) => card.chosen.checked).map((card) => card.data.id);
    this.saveAll.hidden = this.cards.size < 2;
    this.saveAll.href = `/export/${this.system}/${chosen.join(",") || "all"}.zip`;
    showText(this.saveAll, chosen.length ? `Save ${chosen.length === 1 ? "the call chosen" : `the ${chosen.length} calls chosen`} as one report` : "Save all calls as one report");
  }

  showFaults(rover) {
    const faults = model.faults(rover);
    changed(this.faults, [faults, rover.checked], (list) => list.replaceChildren(...(faults.length
      ? faults.map(({ tone, title, text }) => element("li", {}, element("span", { className: "verdict", tone }, tone), element("b", {}, ` ${title}: `), text))
      : [element("li", {}, !rover.checked ? "Nothing is known to be wrong; its checks were not read." : "All its checks pass.")])));
  }

  card(key) {
    return this.cards.get(key);
  }

  refreshCards() {
    for (const card of this.cards.values()) card.refresh();
  }
}
