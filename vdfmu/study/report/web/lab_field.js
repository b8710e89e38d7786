// Values between points: linear over the triangles of Delaunay, as areas and lines.

const MOST = 600, // points of a field; more are averaged in squares
  EACH = 6, // points of a square
  FAR = 1e3; // corners around all points

/**
 * The points of a field, [x, y, value], in shares of their scales; NaN where none of them has a value.
 * Points at one place are averaged, and points in one square if further axes scatter them.
 */
export function gathered(points, scattered) {
  const means = (keyOf) =>
    [...Map.groupBy(points, keyOf).values()].map((near) => {
      const known = near.filter(([, , value]) => !Number.isNaN(value)),
        mean = (list, k) => list.reduce((sum, point) => sum + point[k], 0) / list.length;
      return [mean(near, 0), mean(near, 1), known.length ? mean(known, 2) : NaN];
    });
  const places = means(([x, y]) => `${x.toFixed(9)} ${y.toFixed(9)}`);
  if (places.length <= MOST && !(scattered && places.length === points.length)) return places;
  const side = Math.floor(Math.sqrt(Math.min(points.length / EACH, MOST)));
  return means(([x, y]) => [x, y].map((share) => Math.min(side - 1, Math.floor(share * side))));
}

/** Triangles [a, b, c] of places [x, y, ..], against the clock, by Bowyer and Watson. */
export function triangulate(places) {
  const count = places.length;
  // points of a grid share circles: moved by less than a pixel, rounding need not choose between them
  const at = places.map(([x, y], k) => [x + 1e-7 * Math.sin(79 * k), y + 1e-7 * Math.sin(97 * k)]);
  at.push([-FAR, -FAR], [FAR, -FAR], [0, FAR]);
  const made = (...corners) => {
    const [[ax, ay], [bx, by], [cx, cy]] = corners.map((k) => at[k]),
      [ux, uy, vx, vy] = [bx - ax, by - ay, cx - ax, cy - ay],
      twice = 2 * (ux * vy - uy * vx),
      [u, v] = [ux * ux + uy * uy, vx * vx + vy * vy],
      [x, y] = [(vy * u - uy * v) / twice, (ux * v - vx * u) / twice];
    return { corners, x: ax + x, y: ay + y, square: x * x + y * y };
  };
  let triangles = [made(count, count + 1, count + 2)];
  for (let k = 0; k < count; k += 1) {
    const [x, y] = at[k],
      border = new Map();
    triangles = triangles.filter((triangle) => {
      if ((x - triangle.x) ** 2 + (y - triangle.y) ** 2 >= triangle.square) return true;
      triangle.corners.forEach((from, i) => {
        const to = triangle.corners[(i + 1) % 3];
        if (!border.delete(`${to} ${from}`)) border.set(`${from} ${to}`, [from, to]);
      });
      return false;
    });
    for (const edge of border.values()) triangles.push(made(...edge, k));
  }
  return triangles.map(({ corners }) => corners).filter((each) => each.every((k) => k < count));
}

/** Paths where a field is at a level or above, and along the level; `at` places [x, y]. */
export function levelPaths(places, triangles, level, at) {
  const area = [],
    line = [];
  const path = (points) =>
    `M${points.map((place) => at(place).map((v) => v.toFixed(1))).join("L")}`;
  for (const corners of triangles) {
    const part = [],
      ends = [];
    if (corners.some((k) => Number.isNaN(places[k][2]))) continue;
    corners.forEach((k, i) => {
      const [from, to] = [places[k], places[corners[(i + 1) % 3]]],
        share = (level - from[2]) / (to[2] - from[2]);
      if (from[2] >= level) part.push(from);
      if (from[2] >= level !== to[2] >= level) {
        const end = [0, 1].map((axis) => from[axis] + share * (to[axis] - from[axis]));
        part.push(end);
        ends.push(end);
      }
    });
    if (part.length) area.push(`${path(part)}Z`);
    if (ends.length) line.push(path(ends));
  }
  return { area: area.join(""), line: line.join("") };
}
