// The arm in 3D. Frame {B_i} of joint i is a group of three.js, placed as Eq. (32)-(36) place it in {B_(i-1)}.

import { vendor as T } from "./vendor.js";
import { colourOf, darkScheme, framesOf, inkOf, largest, placeAt, unpack } from "./data.js";

export const POSITIVE = new T.Color(inkOf("positive"));
export const NEGATIVE = new T.Color(inkOf("negative"));
export const NEUTRAL = new T.Color("#a3aeba");

/** The arms of a run, each with its drawing and its frames. */
export const armsOf = (run) => [
  run,
  ...(run.more ?? []).map((one) => ({ ...one, result: run.result })),
];

/** The frames of an arm. */
export class Chain {
  /** Materials of what is coloured by the values of its joint. */
  marked = [];

  constructor(arm) {
    this.types = arm.types;
    this.root = new T.Group();
    let parent = this.root;
    this.links = arm.types.map((_, i) => {
      const placed = new T.Group(),
        link = new T.Group();
      placed.position.set(...arm.offset[i]);
      placed.setRotationFromMatrix(turned(arm.rotation[i]));
      parent.add(placed.add(link));
      parent = link;
      return link;
    });
    this.tool = new T.Group();
    this.tool.position.set(...arm.tool_offset);
    this.tool.setRotationFromMatrix(turned(arm.tool_rotation));
    parent.add(this.tool);
  }

  /** Place the links, and the base by its position and rotation, row by row. */
  set(q, base) {
    if (base) {
      this.root.position.set(...base);
      this.root.setRotationFromMatrix(turned([base.slice(3, 6), base.slice(6, 9), base.slice(9)]));
      this.root.quaternion.normalize(); // between two frames
    }
    this.links.forEach((link, i) => {
      if (this.types[i] === "prismatic") link.position.z = q[i];
      else link.rotation.z = q[i];
    });
    this.root.updateMatrixWorld(true);
  }
}

export const turned = (R) => new T.Matrix4().set(...R[0], 0, ...R[1], 0, ...R[2], 0, 0, 0, 0, 1);

/** Positions, errors, torques, torsion, power and forces of a run at its frames. */
export class Motion {
  /** @type {Float64Array} */
  time;
  /** Rows of the base and of the errors, if they are known. @type {Float64Array[] | undefined} */
  base;
  /** @type {Float64Array[] | undefined} */
  error;
  /** By name the largest absolute value of each joint. @type {Record<string, number[]>} */
  largest = {};

  constructor(run) {
    for (const [name, values] of Object.entries(framesOf(run))) this[name] = values; // q; error, torque, .. where they are known
  }

  /** Values of all joints at a time, between frames on a straight line. */
  at(name, t) {
    const [k, share] = placeAt(this.time, t);
    return this[name].map((row) => (1 - share) * row[k] + share * (row[k + 1] ?? 0));
  }

  row(name, k) {
    return this[name].map((row) => row[k]);
  }

  /** Largest absolute value of each joint. */
  peaks(name) {
    this.largest[name] ??= this[name].map((row) => largest(row));
    return this.largest[name];
  }
}

const times = (R, v) => R.map((row) => row[0] * v[0] + row[1] * v[1] + row[2] * v[2]);

/** Position of the end effector in {I} [m] without a drawing, as [x, y, z]. */
export function toolPosition({ types, offset, rotation, tool_offset: tool }, q) {
  let R = [
      [1, 0, 0],
      [0, 1, 0],
      [0, 0, 1],
    ],
    p = [0, 0, 0];
  const moved = (by) => times(R, by).map((value, axis) => p[axis] + value);
  types.forEach((type, i) => {
    p = moved(offset[i]);
    const turn = rotation[i],
      columns = [0, 1, 2].map((k) =>
        times(
          R,
          turn.map((row) => row[k]),
        ),
      );
    R = [0, 1, 2].map((k) => columns.map((column) => column[k]));
    if (type === "prismatic") p = moved([0, 0, q[i]]);
    else {
      const [c, s] = [Math.cos(q[i]), Math.sin(q[i])];
      R = R.map(([x, y, z]) => [c * x + s * y, c * y - s * x, z]);
    }
  });
  return moved(tool);
}

const errors = new WeakMap();

/** Distance [mm] between desired and actual end effector at the frames: errors are added to positions in double precision. */
export function toolErrors(run) {
  const known = run.result ?? run;
  if (errors.has(known)) return errors.get(known);
  const motion = new Motion(run);
  const values = Float64Array.from(motion.time, (_, k) => {
    const q = motion.row("q", k),
      error = motion.row("error", k),
      desired = toolPosition(
        run.arm,
        q.map((v, i) => v + error[i]),
      );
    return 1e3 * Math.hypot(...toolPosition(run.arm, q).map((v, axis) => v - desired[axis]));
  });
  errors.set(known, { time: motion.time, values });
  return errors.get(known);
}

export function solid(color) {
  return new T.MeshStandardMaterial({ color, roughness: 0.5, metalness: 0.05 });
}

export function ghost() {
  return new T.MeshStandardMaterial({
    color: "#2f8fe8",
    transparent: true,
    opacity: 0.3,
    depthWrite: false,
    polygonOffset: true,
    polygonOffsetFactor: 2,
    polygonOffsetUnits: 2,
  });
}

/** Give the links of a chain bodies, and the end effector its axes. */
export function dress(
  chain,
  /** @type {Record<string, any>} */ { parts, reach },
  material,
  tint = null,
) {
  const bodies = [chain.root, ...chain.links];
  const looks = {
    light: tint ?? (darkScheme.matches ? "#dfe6ee" : "#e9edf2"),
    dark: "#586473",
    joint: NEUTRAL,
  };
  chain.marked = [];
  for (const { body, shape, size, offset, rotation, colour, mesh: faces } of parts) {
    const own = new T.Color(looks[colour] ?? colour);
    const look = material(tint && !looks[colour] ? own.lerp(tint, 0.6) : own),
      mesh = new T.Mesh(faces ? faceted(faces) : shaped(shape, size), look);
    mesh.castShadow = mesh.receiveShadow = !look.transparent;
    mesh.setRotationFromMatrix(turned(rotation));
    mesh.position.set(...offset);
    bodies[body].add(mesh);
    if (colour !== "joint") continue;
    chain.marked.push(look);
    if (shape !== "cylinder" || material === ghost) continue;
    const ring = new T.Mesh(shaped(shape, [1.05 * size[0], 0.22 * size[1]]), solid(colourOf(body)));
    ring.castShadow = true;
    bodies[body].add(ring);
  }
  if (material !== solid) return;
  chain.tool.add(axesOf(0.13 * reach));
}

/** Axes of a frame: x red, y green, z blue. */
export function axesOf(length) {
  const axes = new T.Group(),
    r = 0.046 * length;
  ["#d22f2f", "#2f9e44", "#1667c7"].forEach((color, axis) => {
    const arrow = new T.CylinderGeometry(r, r, length, 12).translate(0, length / 2, 0);
    axes.add(
      new T.Mesh(
        axis === 0 ? arrow.rotateZ(-Math.PI / 2) : axis === 2 ? arrow.rotateX(Math.PI / 2) : arrow,
        new T.MeshBasicMaterial({ color }),
      ),
    );
  });
  return axes;
}

/** Geometry of a mesh: corners of its triangles, and three of their numbers each; its faces are flat. */
function faceted({ corners, triangles }) {
  const points = unpack(corners),
    at = unpack(triangles, Uint32Array),
    geometry = new T.PlaneGeometry(),
    { constructor } = geometry.attributes.position;
  for (const name of ["uv", "normal"]) geometry.deleteAttribute(name);
  geometry.setIndex(null).setAttribute(
    "position",
    new constructor(
      Float32Array.from(
        { length: 3 * at.length },
        (_, k) => points[3 * at[Math.floor(k / 3)] + (k % 3)],
      ),
      3,
    ),
  );
  geometry.computeVertexNormals();
  return geometry;
}

/** Geometry of a shape: sides, half-axes, or radius and length along z. */
function shaped(shape, /** @type {number[]} */ [a, b, c]) {
  if (shape === "box") return new T.BoxGeometry(a, b, c);
  if (shape === "cylinder") return new T.CylinderGeometry(a, a, b, 40).rotateX(Math.PI / 2);
  if (shape === "capsule") return new T.CapsuleGeometry(a, b, 10, 32).rotateX(Math.PI / 2);
  return new T.SphereGeometry(1, 40, 20).scale(a, b ?? a, c ?? a);
}
