// Boxes that an operator draws: left, top, right, bottom in fractions of the frame.

import { element } from "./elements.js";

const LEAST = 0.02; // of a side

// The box around a tap, of a size like the box that the call points at.
export function tapBox(x, y, like) {
  const [width, height] = like ? [like[2] - like[0], like[3] - like[1]] : [0.14, 0.18];
  const left = clamp(x - width / 2, 0, 1 - width), top = clamp(y - height / 2, 0, 1 - height);
  return [left, top, left + width, top + height].map(fraction);
}

export function dragBox(from, to) {
  const sides = (a, b) => {
    const [low, high] = [a, b].map((side) => clamp(side, 0, 1)).sort((one, other) => one - other), first = Math.min(low, 1 - LEAST);
    return [first, Math.max(high, first + LEAST)].map(fraction);
  };
  const [left, right] = sides(from.x, to.x), [top, bottom] = sides(from.y, to.y);
  return [left, top, right, bottom];
}

export function movedBox(box, dx, dy, grow) {
  let [left, top, right, bottom] = box;
  if (grow) {
    right = clamp(right + dx, left + LEAST, 1);
    bottom = clamp(bottom + dy, top + LEAST, 1);
  } else {
    const across = clamp(dx, -left, 1 - right), down = clamp(dy, -top, 1 - bottom);
    [left, right, top, bottom] = [left + across, right + across, top + down, bottom + down];
  }
  return [left, top, right, bottom].map(fraction);
}

// Has a box drawn over a picture by dragging. part: what is pressed, positioned. place: the picture's box in it as
// {left, top, width, height} in fractions, called when it is needed. picked: called with the box; may: whether a press counts;
// dropped: called when a drag ends without a box. Returns {show(box), end()}; show(null) hides what was drawn.
export function dragged(part, place, picked, { may = () => true, dropped = () => {} } = {}) {
  let drag = null; // one at a time, of one finger
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
  const stop = () => {
    drag?.abort();
    drag = null;
  };
  const drop = () => {
    stop();
    show(null);
    dropped();
  };
  const press = (event) => {
    if (event.button !== 0 || !event.isPrimary || drag || !may()) return;
    const from = at(event);
    drag = new AbortController();
    const { signal } = drag;
    const far = (to) => Math.hypot(to.x - from.x, to.y - from.y) > 0.05;
    const on = (name, act) => part.addEventListener(name, (its) => its.pointerId === event.pointerId && act(its), { signal });
    event.preventDefault();
    part.setPointerCapture(event.pointerId);
    on("pointermove", (move) => show(far(at(move)) ? dragBox(from, at(move)) : null));
    on("pointercancel", drop);
    on("lostpointercapture", drop);
    on("pointerup", (last) => {
      if (!far(at(last))) return drop();
      stop();
      picked(dragBox(from, at(last)));
    });
    const escaped = (key) => {
      if (key.key !== "Escape") return;
      key.stopPropagation();
      drop();
    };
    window.addEventListener("keydown", escaped, { signal, capture: true });
  };
  part.append(band);
  part.addEventListener("pointerdown", press);
  const end = () => {
    stop();
    part.removeEventListener("pointerdown", press);
    band.remove();
  };
  return { show, end };
}

// The settings of the file for a region of interest that was drawn.
export function regionOf(box) {
  const [left, top, right, bottom] = box.map((side) => Math.round(1000 * side) / 1000);
  return { "roi.left": left, "roi.top": top, "roi.right": right, "roi.bottom": bottom };
}

const percent = (share) => `${100 * share}%`;
const clamp = (value, low, high) => Math.min(Math.max(value, low), Math.max(low, high));
const fraction = (value) => Math.round(1e4 * value) / 1e4;
