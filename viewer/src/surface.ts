// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Triangles with one colour each, from the meshes of a scene: cut where kinds meet or a value passes a level, as in the
// drawn picture (src/report/scene.cpp).

import { BufferAttribute, BufferGeometry, Color } from 'three';
import { type MeshData, type SceneData, unpacked } from './data';
import { floats, smalls, wholes } from './packed';

export interface Surface {
  geometry: BufferGeometry;
  band: Int16Array; // of each triangle: index into kinds, -1 none
  value: Float32Array | null; // of each corner
}

/** The points of a mesh as the frames go. */
export class Moving {
  private readonly given: ArrayLike<number>;
  private readonly place: Float32Array;
  private readonly point: ArrayLike<number>;
  private readonly by: Float32Array;
  private done = 0;
  private readonly points: Float32Array;

  constructor(readonly mesh: MeshData) {
    const shifts = mesh.shifts!;
    this.given = unpacked(mesh.points);
    this.points = Float32Array.from(this.given);
    this.place = floats(shifts.at);
    this.point = wholes(shifts.point);
    this.by = floats(shifts.by);
  }

  /** The points at a place of the frames; null where they lie as they did when this was asked last. */
  at(place: number): Float32Array | null {
    const along = this.mesh.shifts!.along;
    let count = this.done;
    while (count > 0 && this.place[count - 1]! > place) --count;
    if (count < this.done) count = 0; // back: anew from the start
    const before = this.done;
    if (count === 0 && before > 0) this.points.set(Float32Array.from(this.given));
    while (count < this.place.length && this.place[count]! <= place) {
      const p = 3 * this.point[count]!;
      for (let k = 0; k < 3; ++k) this.points[p + k] = this.given[p + k]! + this.by[count]! * along[k]!;
      ++count;
    }
    this.done = count;
    return count === before ? null : this.points;
  }
}

interface Corner {
  at: [number, number, number];
  normal: [number, number, number];
  value: number;
}

function between(a: Corner, b: Corner, t: number, value: number): Corner {
  const mix = (u: number[], v: number[]): [number, number, number] => [
    u[0]! + t * (v[0]! - u[0]!), u[1]! + t * (v[1]! - u[1]!), u[2]! + t * (v[2]! - u[2]!),
  ];
  return { at: mix(a.at, b.at), normal: mix(a.normal, b.normal), value };
}

/** The parts of a convex polygon below and above a level. */
function cut(polygon: Corner[], level: number): [Corner[], Corner[]] {
  const below: Corner[] = [], above: Corner[] = [];
  polygon.forEach((a, k) => {
    const b = polygon[(k + 1) % polygon.length]!;
    (a.value < level ? below : above).push(a);
    if (a.value < level === b.value < level) return;
    const middle = between(a, b, (level - a.value) / (b.value - a.value), level);
    below.push(middle);
    above.push(middle);
  });
  return [below, above];
}

export function surfaceOf(mesh: MeshData, scene: SceneData, points = unpacked(mesh.points)): Surface {
  const triangles = wholes(mesh.triangles);
  const kinds = mesh.kind === undefined ? null : smalls(mesh.kind);
  const values = mesh.value === undefined ? null : unpacked(mesh.value);
  const normals = new Float32Array(points.length);
  const sub = (i: number, j: number): [number, number, number] => [
    points[3 * i]! - points[3 * j]!, points[3 * i + 1]! - points[3 * j + 1]!, points[3 * i + 2]! - points[3 * j + 2]!,
  ];
  const cross = (u: number[], v: number[]): [number, number, number] => [
    u[1]! * v[2]! - u[2]! * v[1]!, u[2]! * v[0]! - u[0]! * v[2]!, u[0]! * v[1]! - u[1]! * v[0]!,
  ];
  for (let t = 0; t < triangles.length; t += 3) {
    const [a, b, c] = [triangles[t]!, triangles[t + 1]!, triangles[t + 2]!];
    const n = cross(sub(b, a), sub(c, a));
    for (const v of [a, b, c]) for (let k = 0; k < 3; ++k) normals[3 * v + k]! += n[k]!;
  }
  const out: Corner[] = [];
  const bands: number[] = [];
  const draw = (polygon: Corner[], band: number): void => {
    for (let k = 2; k < polygon.length; ++k) {
      out.push(polygon[0]!, polygon[k - 1]!, polygon[k]!);
      bands.push(band);
    }
  };
  const corner = (v: number): Corner => ({
    at: [points[3 * v]!, points[3 * v + 1]!, points[3 * v + 2]!],
    normal: [normals[3 * v]!, normals[3 * v + 1]!, normals[3 * v + 2]!],
    value: values === null ? 0 : values[v]!,
  });
  for (let t = 0; t < triangles.length; t += 3) {
    const index = [triangles[t]!, triangles[t + 1]!, triangles[t + 2]!];
    const p = index.map(corner);
    if (values !== null && scene.levels.length > 0) {
      let rest = p;
      scene.levels.forEach((level, k) => {
        const [below, above] = cut(rest, level);
        draw(below, k);
        rest = above;
      });
      draw(rest, scene.levels.length);
      continue;
    }
    const kind = (k: number): number => (kinds === null ? 0 : kinds[index[k % 3]!]!);
    const alone = [2, 1, 0].find((k) => kind(k) !== kind(k + 1) && kind(k) !== kind(k + 2));
    if (alone === undefined) {
      draw(p, kind(0));
    } else {
      const a = p[alone]!, b = p[(alone + 1) % 3]!, c = p[(alone + 2) % 3]!;
      const ab = between(a, b, 0.5, 0), ac = between(a, c, 0.5, 0);
      draw([a, ab, ac], kind(alone));
      draw([ab, b, c, ac], kind(alone + 1));
    }
  }
  const position = new Float32Array(3 * out.length), normal = new Float32Array(3 * out.length);
  const colour = new Float32Array(3 * out.length);
  const fills = scene.kinds.map((k) => new Color(k.fill));
  const none = new Color(scene.none);
  out.forEach((c, i) => {
    position.set(c.at, 3 * i);
    const length = Math.hypot(...c.normal) || 1;
    normal.set(c.normal.map((x) => x / length), 3 * i);
    const fill = fills[bands[Math.floor(i / 3)]!] ?? none;
    colour.set([fill.r, fill.g, fill.b], 3 * i);
  });
  const geometry = new BufferGeometry();
  geometry.setAttribute('position', new BufferAttribute(position, 3));
  geometry.setAttribute('normal', new BufferAttribute(normal, 3));
  geometry.setAttribute('color', new BufferAttribute(colour, 3));
  geometry.computeBoundingSphere();
  return {
    geometry,
    band: Int16Array.from(bands),
    value: values === null ? null : Float32Array.from(out, (c) => c.value),
  };
}
