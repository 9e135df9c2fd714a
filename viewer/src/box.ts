// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The box of axes: a grid on the three faces that look away from the eye, numbers along the edges.

import { BufferAttribute, BufferGeometry, type Color, LineBasicMaterial, LineSegments, Vector3 } from 'three';
import type { SceneData, Vec } from './data';
import { decimalsOf, fixed, ticks } from './numbers';
import type { View } from './view';

export class Box {
  readonly lines: LineSegments;
  private readonly material = new LineBasicMaterial();
  private side = '';
  private readonly labels: HTMLSpanElement[] = [];

  constructor(private scene: SceneData, private readonly host: HTMLElement) {
    this.lines = new LineSegments(new BufferGeometry(), this.material);
    this.lines.frustumCulled = false;
    this.lines.renderOrder = -1;
  }

  change(scene: SceneData): void {
    this.scene = scene;
    this.side = '';
  }
  recolour(colour: Color): void {
    this.material.color = colour;
  }

  /** For the present view; `width`, `height` of the picture in CSS pixels. */
  update(view: View, width: number, height: number): void {
    const { low, high } = this.scene;
    const eye = view.toEye();
    const away = [eye.x, eye.y, eye.z].map((e) => e >= 0);
    const back = [0, 1, 2].map((k) => (away[k] ? low[k]! : high[k]!)) as Vec;
    const front = [0, 1, 2].map((k) => (away[k] ? high[k]! : low[k]!)) as Vec;
    const perPixel = (view.camera.top - view.camera.bottom) / view.camera.zoom / Math.max(1, height);
    const right = view.right(), up = view.up();
    const ticksOf = (axis: number): number[] => {
      const e = new Vector3(axis === 0 ? 1 : 0, axis === 1 ? 1 : 0, axis === 2 ? 1 : 0);
      const pixels = ((high[axis]! - low[axis]!) * Math.hypot(e.dot(right), e.dot(up))) / perPixel;
      return ticks(low[axis]!, high[axis]!, Math.max(2, Math.min(12, Math.floor(pixels / 46))));
    };
    const all = [0, 1, 2].map(ticksOf);
    const side = `${away.join()} ${all.map((t) => t.length).join()}`;
    if (side !== this.side) {
      this.side = side;
      const at: number[] = [];
      for (let axis = 0; axis < 3; ++axis) {
        for (const across of [(axis + 1) % 3, (axis + 2) % 3]) {
          for (const t of [...all[axis]!, back[axis]!, front[axis]!]) {
            const a = [...back] as Vec, b = [...back] as Vec;
            a[axis] = b[axis] = t;
            b[across] = front[across]!;
            at.push(...a, ...b);
          }
        }
      }
      this.lines.geometry.dispose();
      this.lines.geometry = new BufferGeometry();
      this.lines.geometry.setAttribute('position', new BufferAttribute(Float32Array.from(at), 3));
    }
    const project = (p: Vec): [number, number] => {
      const v = new Vector3(...p).project(view.camera);
      return [((v.x + 1) / 2) * width, ((1 - v.y) / 2) * height];
    };
    const middle = project([0, 1, 2].map((k) => (low[k]! + high[k]!) / 2) as Vec);
    let used = 0;
    const put = (x: number, y: number, text: string, classes: string): void => {
      let label = this.labels[used];
      if (!label) {
        label = document.createElement('span');
        label.setAttribute('aria-hidden', 'true');
        this.labels.push(label);
        this.host.appendChild(label);
      }
      ++used;
      label.className = classes;
      label.textContent = text;
      const half = 3.4 * text.length + 2; // a label whose place is at the edge stays in the picture
      const inside = Math.max(half, Math.min(width - half, x));
      label.style.transform = `translate(${inside.toFixed(1)}px,${y.toFixed(1)}px) translate(-50%,-50%)`;
      const beyond = classes === 'axis' ? 50 : 25;
      label.hidden = x < -beyond || y < -10 || x > width + beyond || y > height + 10;
    };
    for (let axis = 0; axis < 3; ++axis) {
      // An edge that belongs to the outline of the box: between a face in front and one at the back.
      const [u, v] = [(axis + 1) % 3, (axis + 2) % 3] as [number, number];
      const edges = [[u, v], [v, u]].map(([a, b]) => {
        const edge = [...front] as Vec;
        edge[b!] = back[b!]!;
        edge[a!] = front[a!]!;
        return edge;
      });
      const bottom = eye.z >= 0 ? low[2] : high[2];
      const chosen = axis < 2
        ? (edges.find((e) => e[2] === bottom) ?? edges[0]!)
        : edges.reduce((a, b) => (new Vector3(...a).dot(right) < new Vector3(...b).dot(right) ? a : b));
      const ends = [low[axis]!, high[axis]!].map((t) => {
        const p = [...chosen] as Vec;
        p[axis] = t;
        return project(p);
      }) as [[number, number], [number, number]];
      const dx = ends[1][0] - ends[0][0], dy = ends[1][1] - ends[0][1];
      const length = Math.hypot(dx, dy);
      if (length < 30) continue; // seen from its end
      let nx = -dy / length, ny = dx / length;
      const centre = [(ends[0][0] + ends[1][0]) / 2, (ends[0][1] + ends[1][1]) / 2];
      if (nx * (centre[0]! - middle[0]) + ny * (centre[1]! - middle[1]) < 0) {
        nx = -nx;
        ny = -ny;
      }
      const decimals = decimalsOf(all[axis]!);
      let widest = 0;
      for (const t of all[axis]!) {
        const p = [...chosen] as Vec;
        p[axis] = t;
        const [x, y] = project(p);
        const text = fixed(t, decimals);
        widest = Math.max(widest, text.length);
        put(x + (8 + 3.2 * text.length) * nx, y + 12 * ny, text, 'tick');
      }
      const unit = this.scene.unit === '' ? '' : `, ${this.scene.unit}`;
      const off = 27 + (6.5 * widest + 14) * Math.abs(nx);
      const title = this.scene.axes[axis]! + unit, half = 3.4 * title.length + 2;
      let place: [number, number] = [centre[0]! + off * nx, centre[1]! + off * ny];
      // Where there is no room beside the numbers, above the axis.
      if (place[0] < half || place[0] > width - half) {
        const top = ends[0][1] < ends[1][1] ? ends[0] : ends[1];
        place = [top[0], top[1] - 16];
      }
      put(...place, title, 'axis');
    }
    for (let k = used; k < this.labels.length; ++k) this.labels[k]!.hidden = true;
  }
}
