// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Lines and dots of a scene. Their points may come from frames, and may be moved off by a factor.

import { BufferAttribute, BufferGeometry, type Color, Mesh, type Object3D, Points, type ShaderMaterial, type Vector2 } from 'three';
import type { LineData } from './data';
import { dotMaterial, lineMaterial } from './materials';
import { floats } from './packed';

const kAway = 1e30; // where nothing is seen

const pointsOf = (data: LineData): Float32Array => (typeof data.points === 'string' ? floats(data.points) : data.points.slice());

export class Line {
  readonly points: Float32Array; // as they are shown
  readonly values: Float32Array | null;
  readonly object: Object3D;
  private readonly given: Float32Array;
  private readonly segments: Uint32Array; // pairs of points
  private readonly material: ShaderMaterial;
  private readonly geometry = new BufferGeometry();

  constructor(public data: LineData, private readonly colourOf: ((value: number) => Color) | null, pixels: number, points?: Float32Array) {
    this.given = points ?? pointsOf(data);
    this.points = this.given.slice();
    this.values = data.value === undefined ? null : floats(data.value);
    const n = this.points.length / 3, pairs: number[] = [];
    if (!data.dots) for (let i = 1; i < n; ++i) if (Number.isFinite(this.given[3 * i]!) && Number.isFinite(this.given[3 * i - 3]!)) pairs.push(i - 1, i);
    this.segments = Uint32Array.from(pairs);
    if (data.dots) {
      this.material = dotMaterial(2 * data.stroke, pixels);
      this.object = new Points(this.geometry, this.material);
    } else {
      this.material = lineMaterial(data.stroke, this.values !== null);
      this.object = new Mesh(this.geometry, this.material);
      this.corners();
    }
    this.object.frustumCulled = false;
    this.update();
  }

  /** Takes the place of what it was, if it has as many points and the same gaps: no new geometry. */
  becomes(data: LineData): boolean {
    const now = this.data, points = pointsOf(data);
    const same = data.dots === now.dots && data.stroke === now.stroke && data.value === undefined && now.value === undefined && points.length === this.given.length &&
      points.every((x, i) => Number.isFinite(x) === Number.isFinite(this.given[i]!));
    if (!same) return false;
    this.data = data;
    this.given.set(points);
    this.set(points, 0);
    return true;
  }
  /** New points, e.g. of another frame. */
  set(points: ArrayLike<number>, from: number): void {
    for (let i = 0; i < this.points.length; ++i) this.points[i] = points[from + i]!;
    this.update();
  }
  /** The given points and `factor` times `offsets`. */
  shift(offsets: Float32Array, factor: number): void {
    for (let i = 0; i < this.points.length; ++i) this.points[i] = this.given[i]! + factor * offsets[i]!;
    this.update();
  }

  recolour(colour: Color): void {
    if (!this.data.dots) {
      (this.material.uniforms['colour']!.value as Color).copy(colour);
      return;
    }
    const n = this.points.length / 3;
    const colours = new Float32Array(3 * n);
    for (let i = 0; i < n; ++i) {
      const c = this.values !== null && this.colourOf !== null ? this.colourOf(this.values[i]!) : colour;
      colours.set([c.r, c.g, c.b], 3 * i);
    }
    this.geometry.setAttribute('color', new BufferAttribute(colours, 3));
  }
  dispose(): void {
    this.geometry.dispose();
    this.material.dispose();
  }
  /** Dots are as large on the screen whatever pixels it is drawn with. */
  sharpen(pixels: number): void {
    if (this.data.dots) this.material.uniforms['size']!.value = 2 * this.data.stroke * pixels;
  }
  resize(width: number, height: number): void {
    if (!this.data.dots) (this.material.uniforms['resolution']!.value as Vector2).set(width, height);
  }

  /** What of the rectangles stays when points move: two corners at each end of a segment, their sides, two triangles. */
  private corners(): void {
    const count = this.segments.length / 2, sides = new Float32Array(4 * count), triangles = new Uint32Array(6 * count);
    for (let k = 0; k < count; ++k) {
      sides.set([1, -1, -1, 1], 4 * k); // seen from each end towards the other
      triangles.set([0, 1, 2, 1, 3, 2].map((c) => 4 * k + c), 6 * k);
    }
    this.geometry.setAttribute('side', new BufferAttribute(sides, 1));
    this.geometry.setIndex(new BufferAttribute(triangles, 1));
    if (this.values === null || this.colourOf === null) return;
    const colours = new Float32Array(12 * count);
    this.segments.forEach((i, k) => {
      const c = this.colourOf!(this.values![i]!);
      colours.set([c.r, c.g, c.b, c.r, c.g, c.b], 6 * k);
    });
    this.geometry.setAttribute('color', new BufferAttribute(colours, 3));
  }

  private update(): void {
    if (this.data.dots) {
      const attribute = new BufferAttribute(this.points.map((x) => (Number.isFinite(x) ? x : kAway)), 3);
      this.geometry.setAttribute('position', attribute);
      return;
    }
    const count = this.segments.length / 2, own = new Float32Array(12 * count), other = new Float32Array(12 * count);
    for (let k = 0; k < count; ++k) {
      const a = 3 * this.segments[2 * k]!, b = 3 * this.segments[2 * k + 1]!;
      const there = [0, 1, 2].every((c) => Number.isFinite(this.points[a + c]!) && Number.isFinite(this.points[b + c]!));
      for (let c = 0; c < 3; ++c) {
        const from = there ? this.points[a + c]! : kAway, to = there ? this.points[b + c]! : kAway;
        for (let corner = 0; corner < 4; ++corner) {
          own[12 * k + 3 * corner + c] = corner < 2 ? from : to;
          other[12 * k + 3 * corner + c] = corner < 2 ? to : from;
        }
      }
    }
    this.geometry.setAttribute('position', new BufferAttribute(own, 3));
    this.geometry.setAttribute('other', new BufferAttribute(other, 3));
  }
}
