// Makes elements and puts them into the page. What is told is only ever text.

export function element(tag, properties = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(properties)) {
    if (name === "tone") made.dataset.tone = value;
    else if (name.startsWith("aria-") || name === "role" || name === "for" || name === "list") made.setAttribute(name, value);
    else made[name] = value;
  }
  made.append(...children.filter((child) => child !== "" && child != null));
  return made;
}

const SVG = "http://www.w3.org/2000/svg";

export function drawn(tag, attributes = {}, ...children) {
  const made = document.createElementNS(SVG, tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  made.append(...children);
  return made;
}

const shown = new WeakMap();

// Calls `draw` only if `content` differs from what the part shows, so that nothing flickers or scrolls away.
// part: an element, or its id.
export function changed(part, content, draw) {
  const found = typeof part === "string" ? document.getElementById(part) : part;
  const text = JSON.stringify(content);
  if (shown.get(found) === text) return;
  shown.set(found, text);
  draw(found);
}

export function showText(part, text) {
  changed(part, text, (found) => found.replaceChildren(text));
}

// rows: [name, text] each.
export function showFacts(part, rows) {
  changed(part, rows, (found) =>
    found.replaceChildren(...rows.map(([name, text]) => element("div", {}, element("dt", {}, name), element("dd", {}, text)))));
}

// Puts the parts into their home in this order. One that is in its place is not moved, since it may hold the focus.
export function arrange(home, parts, first = 0) {
  parts.forEach((part, at) => home.children[first + at] !== part && home.insertBefore(part, home.children[first + at] ?? null));
}
