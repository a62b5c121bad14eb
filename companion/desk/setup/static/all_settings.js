// All settings of the file by section, with a search.

import { element } from "./elements.js";
import { SettingsList } from "./settings_list.js";

export class SettingsPage {
  constructor(store) {
    this.store = store;
    this.part = element("section", {}, element("h2", {}, "All settings"));
  }

  enter() {
    if (this.list) return;
    this.list = new SettingsList(this.store, { note: "What you change waits on the page Review." });
    this.part.append(this.list.part);
  }

  show() {
    this.list?.show();
  }
}
