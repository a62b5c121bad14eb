// Boxes that an operator draws: left, top, right, bottom in fractions of the frame. Pure.

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

const clamp = (value, low, high) => Math.min(Math.max(value, low), Math.max(low, high));
const fraction = (value) => Math.round(1e4 * value) / 1e4;
