// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Lines and dots of a scene. Their points may come from frames, and may be moved off by a factor.

import { BufferAttribute, BufferGeometry, Color, type Object3D, Points, type ShaderMaterial } from 'three';
import { LineMaterial } from 'three/examples/jsm/lines/LineMaterial.js';
import { LineSegments2 } from 'three/examples/jsm/lines/LineSegments2.js';
import { LineSegmentsGeometry } from 'three/examples/jsm/lines/LineSegmentsGeometry.js';
import { floats, type LineData } from './data';
import { dotMaterial } from './materials';

export class Line {
  readonly points: Float32Array; // as they are shown
  readonly values: Float32Array | null;
  readonly object: Object3D;
  private readonly given: Float32Array;
  private readonly segments: Uint32Array; // pairs of points
  private readonly material: LineMaterial | ShaderMaterial;
  private readonly geometry: LineSegmentsGeometry | BufferGeometry;

  constructor(readonly data: LineData, private readonly colourOf: ((value: number) => Color) | null, pixels: number, points?: Float32Array) {
    this.given = points ?? floats(data.points);
    this.points = this.given.slice();
    this.values = data.value === undefined ? null : floats(data.value);
    const n = this.points.length / 3;
    if (data.dots) {
      this.segments = new Uint32Array();
      this.geometry = new BufferGeometry();
      this.material = dotMaterial(2 * data.stroke, pixels);
      this.object = new Points(this.geometry as BufferGeometry, this.material as ShaderMaterial);
    } else {
      const pairs: number[] = [];
      for (let i = 1; i < n; ++i) if (Number.isFinite(this.given[3 * i]!) && Number.isFinite(this.given[3 * i - 3]!)) pairs.push(i - 1, i);
      this.segments = Uint32Array.from(pairs);
      this.geometry = new LineSegmentsGeometry();
      this.material = new LineMaterial({ linewidth: data.stroke, vertexColors: this.values !== null });
      this.object = new LineSegments2(this.geometry as LineSegmentsGeometry, this.material as LineMaterial);
    }
    this.object.frustumCulled = false;
    this.update();
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
    if (this.material instanceof LineMaterial) {
      if (this.values === null) this.material.color = colour;
      return;
    }
    const n = this.points.length / 3;
    const colours = new Float32Array(3 * n);
    for (let i = 0; i < n; ++i) {
      const c = this.values !== null && this.colourOf !== null ? this.colourOf(this.values[i]!) : colour;
      colours.set([c.r, c.g, c.b], 3 * i);
    }
    (this.geometry as BufferGeometry).setAttribute('color', new BufferAttribute(colours, 3));
  }
  dispose(): void {
    this.geometry.dispose();
    this.material.dispose();
  }
  resize(width: number, height: number): void {
    if (this.material instanceof LineMaterial) this.material.resolution.set(width, height);
  }

  private update(): void {
    if (this.data.dots) {
      const attribute = new BufferAttribute(this.points.map((x) => (Number.isFinite(x) ? x : 1e30)), 3);
      (this.geometry as BufferGeometry).setAttribute('position', attribute);
      return;
    }
    const at = new Float32Array(3 * this.segments.length);
    this.segments.forEach((i, k) => at.set(this.points.subarray(3 * i, 3 * i + 3), 3 * k));
    const geometry = this.geometry as LineSegmentsGeometry;
    geometry.setPositions(at);
    if (this.values !== null && this.colourOf !== null) {
      const colours = new Float32Array(at.length);
      this.segments.forEach((i, k) => {
        const c = this.colourOf!(this.values![i]!);
        colours.set([c.r, c.g, c.b], 3 * k);
      });
      geometry.setColors(colours);
    }
  }
}
