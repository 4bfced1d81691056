// Functions for breaks (polygons over time) in the format of labels.json: shapes with from_s and corners_px, and closes_s.

export const isOpen = (one, time) =>
  one.shapes.length > 0 && one.shapes[0].from_s <= time && (one.closes_s === null || time < one.closes_s);

// "later", "open" or "closed".
export function stateAt(one, time) {
  if (one.shapes.length === 0 || time < one.shapes[0].from_s) return "later";
  return isOpen(one, time) ? "open" : "closed";
}

// Returns the index of the shape that is valid at this time; -1 before the first shape.
export const shapeIndex = (one, time) => one.shapes.findLastIndex((shape) => shape.from_s <= time);

// Returns the corners at a time: those of the valid shape, interpolated to the next shape if both have the same number of corners.
// Before the break begins, returns the corners of the first shape.
export function cornersAt(one, time) {
  const index = shapeIndex(one, time);
  if (index < 0) return one.shapes[0]?.corners_px ?? [];
  const [shape, next] = [one.shapes[index], one.shapes[index + 1]];
  if (!next || next.corners_px.length !== shape.corners_px.length) return shape.corners_px;
  const share = (time - shape.from_s) / (next.from_s - shape.from_s);
  return shape.corners_px.map(([u, v], corner) => {
    const [nextU, nextV] = next.corners_px[corner];
    return [u + (nextU - u) * share, v + (nextV - v) * share];
  });
}

export const rounded = ([u, v]) => [Math.round(u * 10) / 10, Math.round(v * 10) / 10];

// Returns the shape that begins at this time; if there is none, creates it from the displayed corners.
export function shapeFrom(one, time) {
  const index = shapeIndex(one, time);
  if (one.shapes[index]?.from_s === time) return one.shapes[index];
  const made = { from_s: time, corners_px: cornersAt(one, time).map(rounded) };
  one.shapes.splice(index + 1, 0, made);
  return made;
}

// Makes the break begin at this time, with its present shape, or with its first shape if the break begins later.
export function beginAt(one, time) {
  if (time < one.shapes[0].from_s) {
    one.shapes[0].from_s = time;
    return;
  }
  shapeFrom(one, time);
  one.shapes = one.shapes.filter((shape) => shape.from_s >= time);
}

// Closes the break at this time, and removes its later shapes.
export function closeAt(one, time) {
  one.closes_s = time;
  one.shapes = one.shapes.filter((shape) => shape.from_s < time);
}

export const areaPx = (corners) =>
  Math.abs(corners.reduce((sum, [u, v], index) => {
    const [nextU, nextV] = corners[(index + 1) % corners.length];
    return sum + (u * nextV - nextU * v) / 2;
  }, 0));

export const seconds = (time) => `${Number(time.toFixed(2))} s`;

export const inWords = (one) =>
  `${seconds(one.shapes[0].from_s)} to ${one.closes_s === null ? "the end" : seconds(one.closes_s)}`;
