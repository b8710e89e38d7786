// What is around an arm: the plate under it, planes and screws that it touches, arrows of the wrenches that act.

import { darkScheme } from "./data.js";
import { NEUTRAL, POSITIVE, solid } from "./arm.js";
import { vendor } from "./vendor.js";

const Z = new vendor.Vector3(0, 0, 1),
  Y = new vendor.Vector3(0, 1, 0);

const seeThrough = (color, opacity) =>
  Object.assign(solid(color), { transparent: true, opacity, depthWrite: false, side: 2 });

/** Plate of a fixed size at the base, on the side where the arm is fixed. */
export function plate({ mount, offset, rotation, reach }) {
  const r = 0.06 * reach,
    thickness = 0.35 * r,
    side = new vendor.Vector3(...mount);
  const axis = new vendor.Vector3(...rotation[0].map((row) => row[2]));
  const gap =
    new vendor.Vector3(...offset[0]).length() > 1e-9
      ? 0
      : Math.abs(axis.dot(side)) > 0.7
        ? 1.24 * r
        : r;
  const mesh = new vendor.Mesh(
    new vendor.CylinderGeometry(1.6 * r, 1.6 * r, thickness, 48),
    solid("#566270"),
  );
  mesh.quaternion.setFromUnitVectors(Y, side);
  mesh.position.copy(side).multiplyScalar(gap + thickness / 2);
  mesh.castShadow = mesh.receiveShadow = true;
  return Object.assign(mesh, { reaches: gap + thickness });
}

/** Where a tool comes deepest along a direction, moved into the plane of an object. */
function touched({ direction, distance }, points) {
  const along = new vendor.Vector3(...direction);
  const deepest = points.reduce(
    (best, point) => (point.dot(along) > best.dot(along) ? point : best),
    points[0] ?? new vendor.Vector3(),
  );
  return deepest.clone().addScaledVector(along, distance - deepest.dot(along));
}

/** A plane with its grid, where the tool touches it. */
function plane(object, points, reach) {
  const group = new vendor.Group(),
    size = 1.2 * reach,
    colour = darkScheme.matches ? "#8fa1b5" : "#7b8b9c";
  const grid = new vendor.GridHelper(size, 12, colour, colour);
  group.add(
    grid.rotateX(Math.PI / 2),
    new vendor.Mesh(new vendor.PlaneGeometry(size, size), seeThrough(colour, 0.3)),
  );
  group.quaternion.setFromUnitVectors(Z, new vendor.Vector3(...object.direction));
  group.position.copy(touched(object, points));
  return group;
}

/** A screw larger than life, whose head is where the tool presses on it. */
function screw(object, points, reach) {
  const group = new vendor.Group(),
    turning = new vendor.Group(),
    r = 0.045 * reach,
    length = 4 * r;
  const part = (geometry, z, look) => {
    const mesh = new vendor.Mesh(geometry, look);
    mesh.position.z = z;
    mesh.castShadow = mesh.receiveShadow = true;
    return mesh;
  };
  const cylinder = (radius, height, sides) =>
    new vendor.CylinderGeometry(radius, radius, height, sides).rotateX(Math.PI / 2);
  turning.add(
    part(cylinder(r, 0.6 * r, 6), 0.3 * r, solid("#c9a227")),
    part(cylinder(0.45 * r, length, 24), 0.6 * r + length / 2, solid("#8d7a3a")),
  );
  group.add(turning);
  group.quaternion.setFromUnitVectors(Z, new vendor.Vector3(...object.direction));
  group.position.copy(touched(object, points));
  group.turn = (angle) => {
    turning.rotation.z = angle;
    turning.position.z = (object.pitch * angle) / (2 * Math.PI);
  };
  return group;
}

/** Drawing of an object that is touched at the points of a path. */
export const drawn = (object, points, reach) =>
  Object.assign((object.kind === "screw" ? screw : plane)(object, points, reach), { object });

/** Arrow of a force: as long and as coloured as its share of the largest. */
export class Arrow extends vendor.Group {
  constructor(length, look = new vendor.MeshBasicMaterial()) {
    super();
    const r = 0.02 * length,
      head = new vendor.Mesh(
        new vendor.CylinderGeometry(0, 3 * r, 0.16, 24).translate(0, 0.92, 0),
        look,
      );
    this.add(
      new vendor.Mesh(new vendor.CylinderGeometry(r, r, 0.84, 16).translate(0, 0.42, 0), look),
      head,
    );
    this.look = look;
    this.length = length;
  }

  /** Show a vector, whose largest length is `peak`. */
  point([x, y, z], peak) {
    const vector = new vendor.Vector3(x, y, z),
      share = peak > 0 ? vector.length() / peak : 0;
    this.visible = share > 1e-3;
    if (!this.visible) return;
    this.scale.set(1, this.length * share, 1);
    this.quaternion.setFromUnitVectors(Y, vector.normalize());
    this.look.color.copy(NEUTRAL).lerp(POSITIVE, Math.min(1, share));
  }
}

/** Arrow of a torque: three quarters of a turn about z, one way or the other, as wide as its share of the largest. */
export class Arc extends vendor.Group {
  constructor(radius, look = new vendor.MeshBasicMaterial()) {
    super();
    const at = (angle) => new vendor.Vector3(radius * Math.cos(angle), radius * Math.sin(angle), 0);
    const points = Array.from({ length: 25 }, (_, k) => at((k / 24) * 1.4 * Math.PI));
    const head = new vendor.Mesh(
      new vendor.CylinderGeometry(0, 0.16 * radius, 0.4 * radius, 16),
      look,
    );
    head.position.copy(at(1.43 * Math.PI));
    head.rotation.z = 1.43 * Math.PI;
    this.add(
      new vendor.Mesh(
        new vendor.TubeGeometry(new vendor.CatmullRomCurve3(points), 24, 0.05 * radius, 8),
        look,
      ),
      head,
    );
    this.look = look;
    this.turned = new vendor.Group().add(this);
  }

  /** Show a share of the largest, -1 to 1, in a colour; what `turned` holds is this arrow. */
  wind(share, colour) {
    this.visible = Math.abs(share) > 0.02;
    this.scale.setScalar(0.35 + 0.65 * Math.min(1, Math.abs(share)));
    this.rotation.x = share < 0 ? Math.PI : 0;
    this.look.color.copy(colour);
  }

  /** Show a vector, whose largest length is `peak`. */
  point([x, y, z], peak) {
    const vector = new vendor.Vector3(x, y, z),
      share = peak > 0 ? vector.length() / peak : 0;
    if (share > 0) this.turned.quaternion.setFromUnitVectors(Z, vector.normalize());
    this.wind(share, NEUTRAL.clone().lerp(POSITIVE, Math.min(1, share)));
  }
}
