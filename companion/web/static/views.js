// Puts what `model.js` made into the page. No network, and no decision: what is given is what is shown.

import { changed, element, showFacts } from "./elements.js";

export function showState(state) {
  changed("state", { ...state, since: "" }, (part) => {
    part.dataset.tone = state.tone;
    document.title = `${state.title} · AnyTraverse`;
    document.body.classList.toggle("stale", state.stale);
  });
  changed("state-title", state.title, (part) => part.replaceChildren(state.title));
  changed("state-why", state.why, (part) => part.replaceChildren(state.why));
  changed("state-since", state.since, (part) => part.replaceChildren(state.since));
}

export function showPictureNote({ text, fresh }) {
  changed("picture-note", text, (part) => part.replaceChildren(text));
  changed("view", fresh, (part) => part.classList.toggle("stale", !fresh));
}

// place: of `model.place`, or null. Its picture may be gone: then that is said.
export function showPlace(place) {
  changed("place", place, (part) => {
    part.hidden = place === null;
    if (place === null) return;
    document.getElementById("place-title").replaceChildren(place.title);
    showFacts("place-facts", place.rows);
    const [picture, note] = ["place-picture", "place-note"].map((id) => document.getElementById(id));
    const show = (there) => {
      picture.hidden = !there;
      note.replaceChildren(there ? "" : "No picture of it is kept.");
    };
    show(false);
    picture.onload = () => show(true);
    picture.onerror = () => show(false);
    if (place.picture) picture.src = place.picture;
    else picture.removeAttribute("src");
  });
}

export function showWords(words) {
  changed("words", words, (part) =>
    part.replaceChildren(...words.map(({ word, weight, tone }) =>
      element("li", { tone }, element("span", {}, word), " ", element("b", {}, weight)))));
}

export function showCalls(calls) {
  changed("calls", calls, (part) =>
    part.replaceChildren(...(calls.length ? calls.map(call) : [element("li", { className: "none" }, "None so far.")])));
}

function call({ id, title, picture, figures, outcome, open, closed, answers }) {
  const image = picture &&
    element("img", { src: picture, loading: "lazy", decoding: "async", alt: `Picture of call ${id}, with maps` });
  return element("li", { className: open ? "open" : "" },
    image || "",
    element("div", {},
      element("h3", {}, title),
      element("p", {}, element("strong", {}, outcome), closed && ` at ${closed}`),
      figures && element("p", { className: "faint" }, figures),
      answers.length ? element("ul", {}, ...answers.map(({ at, said, result }) =>
        element("li", {}, `${at} `, element("b", {}, said), result && `: ${result}`))) : ""));
}

export function showChecks({ summary, rows }) {
  changed("check", { summary, rows }, (part) => {
    const cells = rows.map(({ check, verdict, text }) =>
      element("tr", {},
        element("td", {}, element("span", { className: "verdict", tone: verdict }, verdict)),
        element("th", { scope: "row" }, check),
        element("td", {}, text)));
    const head = element("thead", {}, element("tr", {}, ...["verdict", "check", "what was found, and what to do"]
      .map((name) => element("th", { scope: "col" }, name))));
    part.replaceChildren(element("p", {}, summary), rows.length ? element("table", {}, head, element("tbody", {}, ...cells)) : "");
  });
}

export function showLog(lines) {
  changed("log", lines, (part) => {
    const follows = part.scrollTop + part.clientHeight >= part.scrollHeight - 8;
    part.replaceChildren(...lines.map(({ line, tone }) => element("span", { tone }, `${line}\n`)));
    if (follows) part.scrollTop = part.scrollHeight;
  });
}

export function showAbout(text) {
  changed("about", text, (part) => part.replaceChildren(text));
}
