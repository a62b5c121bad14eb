// Shows the setting that was chosen in the list or by a click on its point: its TOML, and the command that writes it.
"use strict";

(() => {
  const settings = JSON.parse(document.getElementById("settings").textContent);
  const list = document.getElementById("take");
  const views = {};

  const choose = (number) => {
    const { row, figures, toml, command, warnings, curves } = settings[number];
    list.value = number;
    document.getElementById("figures").textContent = figures;
    document.getElementById("toml").textContent = toml;
    document.getElementById("command").textContent = command;
    document.getElementById("warnings").replaceChildren(...warnings.map((line) => {
      const told = Object.assign(document.createElement("p"), { className: "warning" });
      told.textContent = line;
      return told;
    }));
    document.getElementById("copied").textContent = "";
    views.choice?.data("chosen", [row]).run();
    views.curves?.data("rows", curves).run();
  };

  const copy = async (name) => {
    const from = document.getElementById(name), said = document.getElementById("copied");
    try {
      await navigator.clipboard.writeText(from.textContent);
      said.textContent = "Copied.";
    } catch {
      getSelection().selectAllChildren(from);
      said.textContent = "The browser does not let a page copy: it is selected, press Ctrl and C.";
    }
  };

  list.addEventListener("change", () => choose(list.value));
  for (const button of document.querySelectorAll("[data-copies]")) {
    button.addEventListener("click", () => copy(button.dataset.copies));
  }
  for (const name of ["choice", "curves"]) {
    document.getElementById(name)?.drawn?.then((view) => {
      views[name] = view;
      choose(list.value);
      view.addEventListener("click", (_event, item) => {
        const number = item?.datum?.number;
        if (item?.mark?.marktype === "symbol" && number in settings) choose(number);
      });
    });
  }
})();
