// One rover: its state, the call that is open, what is ahead, words, link, faults, earlier calls, timeline.

import { changed, element, showFacts, showText } from "./elements.js";
import * as model from "./model.js";
import { Cards } from "./cards.js";
import { ConsoleCard } from "./console_card.js";
import { Incident } from "./incident.js";
import { Ground } from "./ground.js";
import { KnownPlace } from "./place.js";
import { Fan, TimePlot } from "./plots.js";
import { Track } from "./track.js";
import { Words } from "./words.js";
import { POLICIES, clock } from "./wording.js";

export class RoverView {
  constructor(system, send, say) {
    Object.assign(this, { system, send, say });
    this.cards = new Cards(() => new ConsoleCard(system, send, say, this.words.staged, () => this.showChosen()));
    this.name = element("h2", { id: `rover${system}` });
    this.title = element("strong");
    this.text = element("span");
    this.strip = element("header", { className: "strip" }, this.name, this.title, this.text);
    this.open = element("div", { className: "open" });
    this.traversability = new TimePlot("Drivable", { above: false, at: 1 });
    this.uncertainty = new TimePlot("Unexplained", { above: true, at: 2 });
    this.fan = new Fan();
    this.words = new Words(system, send, () => this.refreshCards());
    this.place = new KnownPlace("h4", (call) => send("answer", { rover: system, motion: "none", changes: [{ other_place: call }] }), say);
    this.ground = new Ground(() => send("fetch", { rover: system, what: "ground" }));
    this.track = new Track((key) => this.cards.byKey.get(key)?.look());
    this.policy = element("div", { className: "policies", role: "group", "aria-label": "Policy" });
    this.policyText = element("p", { className: "faint" });
    this.facts = element("dl", { className: "facts" });
    this.faults = element("ul", { className: "faults" });
    this.check = element("button", { type: "button", className: "plain", onclick: () => send("fetch", { rover: system, what: "check" }) }, "Ask it what is wrong");
    this.lastMinute = new Incident(send, say);
    this.past = element("div", { className: "past" });
    this.pastTitle = element("h3", {}, "Earlier calls");
    this.more = element("button", { type: "button", className: "plain", onclick: () => send("fetch", { rover: system, what: "calls" }) });
    this.saveAll = element("a", { className: "save", href: `/export/${system}/all.zip`, download: "" }, "Save all calls as one report");
    this.timeline = element("ol", { className: "timeline", tabIndex: 0, "aria-label": "Timeline" });
    const box = (title, ...parts) => element("section", {}, element("h3", {}, title), ...parts);
    this.part = element("article", { className: "rover", "aria-labelledby": `rover${system}` }, this.strip, this.open,
      element("div", { className: "panels" },
        box("Ahead", this.fan.part, this.traversability.part, this.uncertainty.part, this.ground.part, this.place.part),
        this.tracked = box("Track", this.track.part),
        box("Words", this.words.part),
        box("Policy", this.policy, this.policyText),
        box("What is wrong", this.faults, this.check, this.lastMinute.part),
        box("Rover and link", this.facts),
        box("Timeline", this.timeline)),
      this.past);
    this.policy.append(...Object.keys(POLICIES).map((policy) => element("button", { type: "button", value: policy, onclick: () => send("policy", { rover: system, policy }) }, policy)));
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
    this.lastMinute.show("the last minute", { rover: rover.system, call: null }, rover.last_minute);
    this.fan.show(rover.ahead);
    this.traversability.show(points, rover.thresholds.trav, time);
    this.uncertainty.show(points, rover.thresholds.unc, time);
    this.tracked.hidden = !this.track.show(track, rover.position, rover.calls, corners);
    this.words.show(rover);
    this.place.show(rover.known_place);
    this.ground.show(rover.ground, time);
    for (const button of this.policy.children) {
      button.hidden = !model.offered(rover, button.value);
      button.setAttribute("aria-pressed", String(button.value === rover.policy));
    }
    showText(this.policyText, rover.policy ? model.policyText(rover.policy) : "Its policy is not known yet.");
    showFacts(this.facts, model.facts(rover, time));
    this.showFaults(rover);
    changed(this.timeline, entries.at(-1)?.n ?? 0, (list) => list.replaceChildren(...entries.slice(-100).reverse().map(({ at, tone, text }) =>
      element("li", { tone }, element("time", {}, clock(at)), ` ${text}`))));
  }

  showCalls(rover, time) {
    const behind = this.cards.show(rover.calls, { front: this.open, past: this.past, before: [this.pastTitle], after: [this.saveAll, this.more] },
      (card, call) => card.show(call, rover, time));
    this.past.hidden = !behind && rover.earlier === "known" && this.cards.byKey.size < 2;
    this.showChosen();
    this.more.hidden = rover.earlier === "known";
    this.more.disabled = rover.earlier === "coming";
    showText(this.more, rover.earlier === "coming" ? "Earlier calls are on their way" : "Fetch the calls before this console began");
  }

  // The report is of the calls that are chosen, or of all.
  showChosen() {
    const chosen = [...this.cards.byKey.values()].filter((card) => card.chosen.checked).map((card) => card.data.id);
    this.saveAll.hidden = this.cards.byKey.size < 2;
    this.saveAll.href = `/export/${this.system}/${chosen.join(",") || "all"}.zip`;
    showText(this.saveAll, chosen.length ? `Save ${chosen.length === 1 ? "the call chosen" : `the ${chosen.length} calls chosen`} as one report` : "Save all calls as one report");
  }

  showFaults(rover) {
    const faults = model.faults(rover);
    changed(this.faults, [faults, rover.checked], (list) => list.replaceChildren(...(faults.length
      ? faults.map(({ tone, title, text }) => element("li", {}, element("span", { className: "verdict", tone }, tone), element("b", {}, ` ${title}: `), text))
      : [element("li", {}, !rover.checked ? "Nothing is known to be wrong; its checks were not read." : "All its checks pass.")])));
  }

  refreshCards() {
    for (const card of this.cards.byKey.values()) card.refresh();
  }
}
