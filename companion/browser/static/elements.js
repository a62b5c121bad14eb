// Makes elements and puts them into the page. What is told is only ever text.

export function element(tag, properties = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(properties)) {
    if (name === "tone") made.dataset.tone = value;
    else made[name] = value;
  }
  made.append(...children.filter((child) => child !== ""));
  return made;
}

const shown = new Map();

// Calls `draw` only if `content` differs from what the part shows, so that nothing flickers or scrolls away.
export function changed(id, content, draw) {
  const text = JSON.stringify(content);
  if (shown.get(id) === text) return;
  shown.set(id, text);
  draw(document.getElementById(id));
}

export function showFacts(id, rows) {
  changed(id, rows, (part) =>
    part.replaceChildren(...rows.map(([name, text]) => element("div", {}, element("dt", {}, name), element("dd", {}, text)))));
}
