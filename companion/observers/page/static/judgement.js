// Draws a recorded frame with how it was judged: green is drivable, vermilion is not, violet stripes are unknown.

const DRIVABLE = [0, 158, 115], BLOCKED = [213, 94, 0], UNKNOWN = "#7e2fbe";
const TINT = 0.3, UNSURE = 0.35, STRIPES = 0.8; // as the rover's own pictures have it, a little stronger

// packed: base64 of a picture. Returns a promise of it, of null for "".
export function unpacked(packed, type) {
  if (!packed) return null;
  return createImageBitmap(new Blob([Uint8Array.from(atob(packed), (letter) => letter.charCodeAt(0))], { type }));
}

// shown: {picture, traversability, uncertainty} as `unpacked` makes them, and outlines in pixels. judged: whether to show the judgement.
export function draw(canvas, { picture, traversability, uncertainty, outlines }, judged) {
  const { width, height } = picture;
  Object.assign(canvas, { width, height });
  const paper = canvas.getContext("2d");
  paper.drawImage(picture, 0, 0);
  if (judged && traversability && uncertainty) {
    paper.drawImage(tinted(traversability), 0, 0, width, height);
    paper.drawImage(striped(uncertainty, width, height), 0, 0);
  }
  outlines.forEach((corners, at) => {
    const path = new Path2D(`M${corners.map((corner) => corner.join(",")).join("L")}Z`);
    for (const [style, line] of [["#141414", 4], [at ? "#ffe13c" : "#fff", 2]]) {
      Object.assign(paper, { strokeStyle: style, lineWidth: (line * width) / 480 });
      paper.stroke(path);
    }
  });
}

// Returns a layer of the map's size. colour: returns [red, green, blue, alpha of 0 to 1] of a value of 0 to 255.
function layer(map, colour) {
  const made = new OffscreenCanvas(map.width, map.height), paper = made.getContext("2d");
  paper.drawImage(map, 0, 0);
  const read = paper.getImageData(0, 0, map.width, map.height), { data } = read;
  for (let at = 0; at < data.length; at += 4) {
    const [red, green, blue, alpha] = colour(data[at]);
    data.set([red, green, blue, 255 * alpha], at);
  }
  paper.putImageData(read, 0, 0);
  return made;
}

function tinted(traversability) {
  return layer(traversability, (value) => {
    const share = value / 127.5 - 1;
    return [...(share > 0 ? DRIVABLE : BLOCKED), TINT * Math.abs(share)];
  });
}

function striped(uncertainty, width, height) {
  const strength = layer(uncertainty, (value) => [0, 0, 0, STRIPES * Math.max(0, (value / 255 - UNSURE) / (1 - UNSURE))]);
  const made = new OffscreenCanvas(width, height), paper = made.getContext("2d");
  paper.drawImage(strength, 0, 0, width, height);
  const step = Math.max(6, width / 50);
  Object.assign(paper, { globalCompositeOperation: "source-in", strokeStyle: UNKNOWN, lineWidth: step / 3 });
  paper.beginPath();
  for (let at = -height; at < width; at += step) paper.moveTo(at, height), paper.lineTo(at + height, 0);
  paper.stroke();
  return made;
}
