// Boxes that an operator draws: left, top, right, bottom in fractions of the frame.

import { element } from "./elements.js";

// The box around a tap, of a size like the box that the call points at.
export function tapBox(x, y, like) {
  const [width, height] = like ? [like[2] - like[0], like[3] - like[1]] : [0.14, 0.18];
  const left = clamp(x - width / 2, 0, 1 - width), top = clamp(y - height / 2, 0, 1 - height);
  return [left, top, left + width, top + height].map(fraction);
}

export function dragBox(from, to) {
  const [left, right] = [from.x, to.x].sort((a, b) => a - b), [top, bottom] = [from.y, to.y].sort((a, b) => a - b);
  return [left, top, Math.max(right, left + 0.02), Math.max(bottom, top + 0.02)].map((side) => fraction(clamp(side, 0, 1)));
}

export function movedBox(box, dx, dy, grow) {
  let [left, top, right, bottom] = box;
  if (grow) {
    right = clamp(right + dx, left + 0.02, 1);
    bottom = clamp(bottom + dy, top + 0.02, 1);
  } else {
    const across = clamp(dx, -left, 1 - right), down = clamp(dy, -top, 1 - bottom);
    [left, right, top, bottom] = [left + across, right + across, top + down, bottom + down];
  }
  return [left, top, right, bottom].map(fraction);
}

// Has a box drawn over a picture by dragging. part: what is pressed, positioned. place: the picture's box in it as
// {left, top, width, height} in fractions, called when it is needed. picked: called with the box; may: whether a press counts.
// Returns {show(box), end()}; show(null) hides what was drawn.
export function dragged(part, place, picked, may = () => true) {
  const band = element("div", { className: "band", hidden: true });
  const show = (box) => {
    band.hidden = !box;
    if (!box) return;
    const { left, top, width, height } = place();
    Object.assign(band.style, { left: percent(left + box[0] * width), top: percent(top + box[1] * height), width: percent((box[2] - box[0]) * width), height: percent((box[3] - box[1]) * height) });
  };
  const at = ({ clientX, clientY }) => {
    const whole = part.getBoundingClientRect(), { left, top, width, height } = place();
    return { x: ((clientX - whole.left) / whole.width - left) / width, y: ((clientY - whole.top) / whole.height - top) / height };
  };
  const press = (event) => {
    if (event.button !== 0 || !may()) return;
    const from = at(event), drag = new AbortController();
    const far = (to) => Math.hypot(to.x - from.x, to.y - from.y) > 0.05;
    const on = (name, act) => part.addEventListener(name, act, { signal: drag.signal });
    event.preventDefault();
    part.setPointerCapture(event.pointerId);
    on("pointermove", (move) => far(at(move)) && show(dragBox(from, at(move))));
    on("pointercancel", () => (drag.abort(), show(null)));
    on("pointerup", (last) => {
      drag.abort();
      if (far(at(last))) picked(dragBox(from, at(last)));
    });
  };
  part.append(band);
  part.addEventListener("pointerdown", press);
  return { show, end: () => (part.removeEventListener("pointerdown", press), band.remove()) };
}

// The settings of the file for a region of interest that was drawn.
export function regionOf(box) {
  const [left, top, right, bottom] = box.map((side) => Math.round(1000 * side) / 1000);
  return { "roi.left": left, "roi.top": top, "roi.right": right, "roi.bottom": bottom };
}

const percent = (share) => `${100 * share}%`;
const clamp = (value, low, high) => Math.min(Math.max(value, low), Math.max(low, high));
const fraction = (value) => Math.round(1e4 * value) / 1e4;
