// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The eye of a scene: a parallel projection that turns about its middle by mouse, touch and keys.

import { OrthographicCamera, Vector3 } from 'three';
import type { Vec } from './data';

const kDegree = Math.PI / 180;

export class View {
  readonly camera = new OrthographicCamera(-1, 1, 1, -1, 0, 1);
  azimuth: number;
  elevation: number;
  private zoom = 1;
  private readonly middle = new Vector3();
  private size = 1;
  private readonly home: [number, number];
  private readonly homeMiddle = new Vector3();
  private aspect = 1;

  /** `low`, `high`: the box that is to be seen. */
  constructor(private low: Vec, private high: Vec, start: [number, number], private readonly changed: () => void) {
    this.setBox(low, high, false);
    this.home = start;
    [this.azimuth, this.elevation] = start;
  }

  setBox(low: Vec, high: Vec, apply = true): void {
    this.low = low;
    this.high = high;
    this.homeMiddle.set(...low).add(new Vector3(...high)).multiplyScalar(0.5);
    this.middle.copy(this.homeMiddle);
    this.size = Math.hypot(high[0] - low[0], high[1] - low[1], high[2] - low[2]) || 1;
    if (apply) this.apply();
  }

  reset(): void {
    [this.azimuth, this.elevation] = this.home;
    this.zoom = 1;
    this.middle.copy(this.homeMiddle);
    this.apply();
  }
  look(azimuth: number, elevation: number): void {
    this.azimuth = azimuth;
    this.elevation = elevation;
    this.apply();
  }
  turn(azimuth: number, elevation: number): void {
    this.azimuth = (((this.azimuth + azimuth + 180) % 360) + 360) % 360 - 180;
    this.elevation = Math.max(-90, Math.min(90, this.elevation + elevation));
    this.apply();
  }
  /** The point in the middle; `size`: how much of the world round it is to be seen. */
  centre(at: Vec, size?: number): void {
    this.middle.set(...at);
    if (size !== undefined) this.zoom = Math.max(0.3, Math.min(400, this.size / (size || 1)));
    this.apply();
  }
  zoomBy(factor: number): void {
    this.zoom = Math.max(0.3, Math.min(400, this.zoom * factor));
    this.apply();
  }
  /** By pixels. */
  pan(dx: number, dy: number, heightPx: number): void {
    const scale = (this.camera.top - this.camera.bottom) / this.camera.zoom / Math.max(1, heightPx);
    this.middle.addScaledVector(this.right(), -dx * scale).addScaledVector(this.up(), dy * scale);
    this.apply();
  }
  resize(width: number, height: number): void {
    this.aspect = width / Math.max(1, height);
    this.apply();
  }
  /** From the middle to the eye. */
  toEye(): Vector3 {
    const az = this.azimuth * kDegree, el = this.elevation * kDegree;
    return new Vector3(Math.cos(el) * Math.cos(az), Math.cos(el) * Math.sin(az), Math.sin(el));
  }
  right(): Vector3 {
    const az = this.azimuth * kDegree;
    return new Vector3(-Math.sin(az), Math.cos(az), 0);
  }
  up(): Vector3 {
    return this.toEye().cross(this.right());
  }

  apply(): void {
    const eye = this.toEye(), right = this.right(), up = this.up();
    // The box fills the picture at the view that the page begins with, with room for numbers; turning does not resize it.
    let wide = 0, tall = 0;
    const az = this.home[0] * kDegree, el = this.home[1] * kDegree;
    const homeEye = new Vector3(Math.cos(el) * Math.cos(az), Math.cos(el) * Math.sin(az), Math.sin(el));
    const homeRight = new Vector3(-Math.sin(az), Math.cos(az), 0);
    const homeUp = homeEye.clone().cross(homeRight);
    for (let k = 0; k < 8; ++k) {
      const p = new Vector3(k & 1 ? this.high[0] : this.low[0], k & 2 ? this.high[1] : this.low[1], k & 4 ? this.high[2] : this.low[2])
        .sub(this.homeMiddle);
      wide = Math.max(wide, Math.abs(p.dot(homeRight)));
      tall = Math.max(tall, Math.abs(p.dot(homeUp)));
    }
    // Flat and long boxes are larger from other sides: their diagonal has most of its room, too.
    wide = Math.max(wide, 0.39 * this.size);
    tall = Math.max(tall, 0.36 * this.size);
    const kRoom = 1.14;
    const half = Math.max(tall * kRoom, (wide * kRoom) / this.aspect) || 1;
    const c = this.camera;
    c.top = half;
    c.bottom = -half;
    c.right = half * this.aspect;
    c.left = -c.right;
    c.zoom = this.zoom;
    c.near = 0;
    c.far = 8 * this.size;
    c.position.copy(this.middle).addScaledVector(eye, 4 * this.size);
    c.up.copy(up);
    // At a pole the direction alone does not say what is up: the axes do.
    c.matrix.makeBasis(right, up, eye).setPosition(c.position);
    c.matrixAutoUpdate = false;
    c.matrixWorldNeedsUpdate = true;
    c.updateProjectionMatrix();
    this.changed();
  }
}

/** Drags, pinches, the wheel and keys on `element` move `view`. */
export function steer(view: View, element: HTMLElement): void {
  const pointers = new Map<number, { x: number; y: number }>();
  let spread = 0;
  const spreadOf = (): number => {
    const [a, b] = [...pointers.values()];
    return a && b ? Math.hypot(a.x - b.x, a.y - b.y) : 0;
  };
  element.addEventListener('pointerdown', (e) => {
    if (e.pointerType === 'mouse' && e.button > 2) return;
    pointers.set(e.pointerId, { x: e.clientX, y: e.clientY });
    spread = spreadOf();
    try {
      element.setPointerCapture(e.pointerId);
    } catch {
      // The pointer has gone already.
    }
    element.focus({ preventScroll: true, focusVisible: false } as FocusOptions);
    element.classList.add('turning');
  });
  element.addEventListener('pointermove', (e) => {
    const last = pointers.get(e.pointerId);
    if (!last) return;
    const dx = e.clientX - last.x, dy = e.clientY - last.y;
    pointers.set(e.pointerId, { x: e.clientX, y: e.clientY });
    if (pointers.size > 1) {
      const now = spreadOf();
      if (spread > 0 && now > 0) view.zoomBy(now / spread);
      spread = now;
      view.pan(dx / pointers.size, dy / pointers.size, element.clientHeight);
    } else if (e.shiftKey || (e.buttons & 6) !== 0) {
      view.pan(dx, dy, element.clientHeight);
    } else {
      view.turn(-0.45 * dx, 0.45 * dy);
    }
  });
  const up = (e: PointerEvent): void => {
    pointers.delete(e.pointerId);
    spread = spreadOf();
    if (pointers.size === 0) element.classList.remove('turning');
  };
  element.addEventListener('pointerup', up);
  element.addEventListener('pointercancel', up);
  element.addEventListener('contextmenu', (e) => e.preventDefault());
  // Where the page scrolls, the wheel belongs to it, until the scene has the focus.
  element.addEventListener('wheel', (e) => {
    if (document.activeElement !== element && !e.ctrlKey) return;
    e.preventDefault();
    const lines = e.deltaMode === 1 ? 18 : e.deltaMode === 2 ? 400 : 1;
    view.zoomBy(Math.exp(-0.0016 * Math.max(-300, Math.min(300, e.deltaY * lines))));
  }, { passive: false });
  element.addEventListener('keydown', (e) => {
    if (e.altKey || e.ctrlKey || e.metaKey) return;
    const arrows: Record<string, [number, number]> = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
    const arrow = arrows[e.key];
    if (arrow) {
      if (e.shiftKey) view.pan(24 * arrow[0], 24 * arrow[1], element.clientHeight);
      else view.turn(-6 * arrow[0], 6 * arrow[1]);
    } else if (e.key === '+' || e.key === '=') view.zoomBy(1.15);
    else if (e.key === '-') view.zoomBy(1 / 1.15);
    else if (e.key === '0' || e.key === 'Home') view.reset();
    else return;
    e.preventDefault();
  });
}
