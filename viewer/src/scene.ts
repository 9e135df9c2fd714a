// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// One scene of a page: the canvas, what can be switched and moved beside it, and what the pointer reads.

import { Color, ColorManagement, LinearSRGBColorSpace, Mesh, Raycaster, Scene, Vector2, Vector3, WebGLRenderer } from 'three';
import { Box } from './box';
import { type FramesData, type LineData, type MeshData, type SceneData, unpacked, type Vec } from './data';
import { Line } from './lines';
import { surfaceMaterial } from './materials';
import { fixed, shown } from './numbers';
import { floats } from './packed';
import { Moving, type Surface, surfaceOf } from './surface';
import { steer, View } from './view';

ColorManagement.enabled = false;

interface Tip {
  show(rows: string[], x: number, y: number): void;
  hide(): void;
}

function element<K extends keyof HTMLElementTagNameMap>(name: K, classes: string, text = ''): HTMLElementTagNameMap[K] {
  const out = document.createElement(name);
  if (classes !== '') out.className = classes;
  if (text !== '') out.textContent = text;
  return out;
}

/** As the axes of curves are titled. */
const titled = (name: string, unit: string): string => (unit === '' ? name : `${name}, ${unit}`);

function button(text: string, label: string, done: () => void): HTMLButtonElement {
  const out = element('button', '', text);
  out.type = 'button';
  out.title = label;
  out.setAttribute('aria-label', label);
  out.addEventListener('click', done);
  return out;
}

function slider(name: string, low: number, high: number, step: number, at: number, say: (v: number) => string, moved: (v: number) => void): {
  row: HTMLElement;
  input: HTMLInputElement;
  set(v: number): void;
} {
  const row = element('label', 'slide');
  const input = element('input', '');
  input.type = 'range';
  input.min = String(low);
  input.max = String(high);
  input.step = String(step);
  const out = element('output', '');
  const told = (v: number): void => {
    out.textContent = say(v);
    input.setAttribute('aria-valuetext', say(v));
  };
  input.addEventListener('input', () => {
    told(Number(input.value));
    moved(Number(input.value));
  });
  row.append(element('span', '', name), input, out);
  const set = (v: number): void => {
    input.value = String(v);
    told(v);
  };
  set(at);
  return { row, input, set };
}

export class Picture {
  private readonly renderer: WebGLRenderer;
  private readonly scene = new Scene();
  private readonly view: View;
  private readonly box: Box;
  private lines: Line[];
  private readonly pixels = Math.min(2, window.devicePixelRatio || 1);
  private readonly surfaces: { mesh: Mesh; surface: Surface; moving: Moving | null }[] = [];
  private readonly height = { value: new Vector2(-1e30, 1e30) };
  private readonly panel = element('div', 'controls');
  private readonly stage = element('div', 'stage');
  private width = 1;
  private tall = 1;
  private waiting = false;
  private drawn = -1e9; // ms, when the last picture was
  private moved = 0;
  private coarse = 1; // share of the pixels of pictures that move
  private sharp = 1;
  private rest = 0;
  private marked: Line | null = null;
  private frame: { of: number; index: number } | null = null;
  private readonly framePoints: (Float32Array | null)[];
  private readonly note = element('p', 'note');
  private readonly reading = element('dl', 'reading');
  private readonly sliders: { set(v: number): void }[] = [];
  private readonly text = element('p', 'now');
  private readonly jumps: (((index: number) => void) | null)[] = [];
  private follows = false;
  private readonly hidden = new Set<string>(); // layers that are switched off

  /** Throws where the browser has no WebGL. */
  constructor(private readonly figure: HTMLElement, private readonly canvas: HTMLCanvasElement, private data: SceneData, private readonly tip: Tip) {
    this.renderer = new WebGLRenderer({ canvas, antialias: true, alpha: true, preserveDrawingBuffer: true });
    this.renderer.outputColorSpace = LinearSRGBColorSpace;
    this.renderer.setClearColor(0x000000, 0);
    this.renderer.setPixelRatio(this.pixels);
    this.view = new View(data.low, data.high, data.view, () => this.request());
    const labels = element('div', 'labels');
    this.box = new Box(data, labels);
    this.scene.add(this.box.lines);
    for (const mesh of data.meshes) this.addMesh(mesh);
    const colours = data.colours;
    const map = colours?.map.map((c) => new Color(c)) ?? [];
    const colourOf = colours === undefined ? null : (value: number): Color => {
      const t = Math.max(0, Math.min(1, (value - colours.low) / (colours.high - colours.low || 1)));
      return map[Math.round(t * (map.length - 1))] ?? new Color(0x888888);
    };
    this.lines = data.lines.map((line) => new Line(line, line.value === undefined ? null : colourOf, this.pixels));
    for (const line of this.lines) this.scene.add(line.object);
    this.framePoints = data.frames.map(() => null);

    canvas.before(this.stage);
    this.stage.append(canvas, labels, this.toolbar());
    this.stage.after(this.panel);
    this.controls();
    canvas.tabIndex = 0;
    canvas.setAttribute('role', 'img');
    canvas.setAttribute('aria-label', `${data.title}. Arrow keys turn it, plus and minus zoom, with shift the arrows move it, 0 resets it.`);
    figure.classList.add('live');
    steer(this.view, canvas);
    this.hover();
    this.picking();
    this.linking();
    this.theme();
    window.matchMedia('(prefers-color-scheme:dark)').addEventListener('change', () => this.theme());
    new ResizeObserver(() => this.resize()).observe(this.stage);
    canvas.addEventListener('webglcontextlost', (e) => {
      e.preventDefault();
      figure.classList.remove('live');
    });
    canvas.addEventListener('webglcontextrestored', () => {
      figure.classList.add('live');
      this.request();
    });
    this.resize();
    this.draw();
  }

  private toolbar(): HTMLElement {
    const bar = element('div', 'bar');
    bar.setAttribute('role', 'group');
    bar.setAttribute('aria-label', 'View');
    const hangs = this.data.axes[2]!.startsWith('\u2212');
    bar.append(
      button('⟲', 'Reset the view', () => this.view.reset()),
      button('+', 'Zoom in', () => this.view.zoomBy(1.25)),
      button('−', 'Zoom out', () => this.view.zoomBy(0.8)),
      button('top', hangs ? 'Seen from the base' : 'Seen from above', () => this.view.look(-90, 90)),
      button('front', 'Seen along y', () => this.view.look(-90, 0)),
      button('side', 'Seen along x', () => this.view.look(0, 0)),
      button('PNG', 'Save this view as a picture (PNG)', () => this.save()),
    );
    return bar;
  }

  private controls(): void {
    // One switch a name: kinds of colour tell, lines and surfaces show and hide.
    const legend = element('ul', 'legend');
    for (const kind of this.data.kinds) {
      if (!kind.shown) continue;
      const entry = element('li', '');
      const swatch = element('i', '');
      swatch.style.background = kind.fill;
      entry.append(swatch, kind.name);
      legend.append(entry);
    }
    const switches = new Map<string, HTMLElement>();
    const layer = (name: string, colour: string, dots: boolean): void => {
      if (name === '' || switches.has(name)) return;
      const swatch = element('i', dots ? 'dot' : 'line');
      swatch.style.background = colour;
      switches.set(name, swatch);
    };
    for (const mesh of this.data.meshes) layer(mesh.name, 'var(--muted)', false);
    for (const line of this.lines) layer(line.data.layer, line.values ? 'var(--orange)' : `var(--${line.data.colour})`, line.data.dots);
    for (const [name, swatch] of switches) {
      const entry = element('li', ''), label = element('label', ''), box = element('input', '');
      box.type = 'checkbox';
      box.checked = true;
      box.addEventListener('change', () => {
        if (box.checked) this.hidden.delete(name);
        else this.hidden.add(name);
        this.data.meshes.forEach((mesh, k) => { if (mesh.name === name) this.surfaces[k]!.mesh.visible = box.checked; });
        for (const line of this.lines) if (line.data.layer === name) line.object.visible = box.checked;
        this.request();
      });
      label.append(box, swatch, name);
      entry.append(label);
      legend.append(entry);
    }
    if (legend.childElementCount > 0) this.panel.append(legend);
    if (this.data.colours) this.panel.append(this.colourBar());
    const sliders = element('div', 'slides');
    if (this.data.meshes.length > 0) {
      const [low, high] = [this.data.low[2], this.data.high[2]];
      const unit = this.data.unit === '' ? '' : ` ${this.data.unit}`;
      const cut = slider(`cut above ${this.data.axes[2]}`, low, high, (high - low) / 400, high,
        (v) => (v >= high ? 'whole' : fixed(v, high - low < 20 ? 2 : 0) + unit), (v) => {
          this.height.value.y = v >= high ? 1e30 : v;
          this.request();
        });
      sliders.append(cut.row);
      const opacity = slider('surface', 0, 1, 0.02, this.data.meshes[0]!.opacity, (v) => `${Math.round(100 * v)} %`, (v) => {
        this.surfaces.forEach(({ mesh }, k) => {
          const material = mesh.material as ReturnType<typeof surfaceMaterial>;
          const own = this.data.meshes[k]!.opacity;
          const first = this.data.meshes[0]!.opacity;
          const now = first > 0 ? Math.min(1, (own * v) / first) : v;
          material.uniforms['opacity']!.value = now;
          material.transparent = now < 1;
          material.depthWrite = now >= 1;
          mesh.visible = now > 0;
        });
        this.request();
      });
      sliders.append(opacity.row);
    }
    const shift = this.data.shift;
    if (shift) {
      const offsets = shift.offsets.map(floats);
      const apply = (v: number): void => {
        shift.lines.forEach((line, k) => this.lines[line]!.shift(offsets[k]!, v));
        this.request();
      };
      sliders.append(slider(shift.name, 0, shift.most, shift.most / 200, shift.at, (v) => `× ${fixed(v, v < 10 ? 1 : 0)}`, apply).row);
      apply(shift.at);
    }
    this.data.frames.forEach((frames, k) => {
      const last = frames.at.length - 1;
      if (last < 0) return;
      const unit = frames.unit === '' ? '' : ` ${frames.unit}`;
      const span = frames.at[last]! - frames.at[0]!;
      const made = slider(frames.name, 0, last, 1, frames.start, (v) => shown(frames.at[v]!, span) + unit, (v) => this.show(k, v));
      this.sliders[k] = made;
      sliders.append(made.row);
      if (frames.plays) sliders.append(this.player(k, made));
    });
    if (sliders.childElementCount > 0) this.panel.append(sliders);
    if (this.data.frames.filter((f) => !f.plays).length > 1) {
      this.panel.append(element('p', 'still', 'Each of these sliders moves one coordinate of the tool, or one joint (q), while the others of its kind stay where they are at the start.'));
    }
    if (this.data.frames.length > 0) {
      this.note.setAttribute('role', 'status');
      this.text.hidden = true;
      this.panel.append(this.text, this.reading, this.note);
      this.show(0, this.data.frames[0]!.start);
    }
  }

  private colourBar(): HTMLElement {
    const c = this.data.colours!;
    const bar = element('div', 'ramp');
    const fill = element('i', '');
    fill.style.background = `linear-gradient(90deg,${c.map.join(',')})`;
    const unit = c.unit === '' ? '' : ` ${c.unit}`;
    bar.append(element('span', '', c.name), element('span', '', shown(c.low, c.high - c.low)), fill, element('span', '', shown(c.high, c.high - c.low) + unit));
    return bar;
  }

  /** Play, pause, steps and speed over frames in time. */
  private player(k: number, made: { set(v: number): void }): HTMLElement {
    const frames = this.data.frames[k]!;
    const row = element('div', 'player');
    const last = frames.at.length - 1;
    let at = frames.at[frames.start]!, playing = false, before = 0, speed = 1;
    const index = (): number => (this.frame !== null && this.frame.of === k ? this.frame.index : frames.start);
    const go = (i: number): void => {
      const to = Math.max(0, Math.min(last, i));
      made.set(to);
      this.show(k, to);
    };
    const tick = (now: number): void => {
      if (!playing) return;
      at += ((now - before) / 1000) * speed;
      before = now;
      if (at >= frames.at[last]!) {
        go(last);
        pause();
        return;
      }
      let i = 0;
      while (i < last && frames.at[i + 1]! <= at) ++i;
      if (i !== index()) go(i);
      requestAnimationFrame(tick);
    };
    const play = button('▶', 'Play', () => (playing ? pause() : start()));
    const pause = (): void => {
      playing = false;
      play.textContent = '▶';
      play.setAttribute('aria-label', 'Play');
    };
    const start = (): void => {
      if (index() >= last) go(0);
      at = frames.at[index()]!;
      before = performance.now();
      playing = true;
      play.textContent = 'Ⅱ';
      play.setAttribute('aria-label', 'Pause');
      requestAnimationFrame(tick);
    };
    const step = (by: number): void => {
      pause();
      go(index() + by);
    };
    this.jumps[k] = (to) => {
      pause();
      go(to);
    };
    const choice = element('select', '');
    choice.setAttribute('aria-label', 'Speed');
    for (const s of [0.01, 0.1, 0.25, 0.5, 1, 2, 5, 20]) {
      const option = element('option', '', `× ${s}`);
      option.value = String(s);
      option.selected = s === 1;
      choice.append(option);
    }
    choice.addEventListener('change', () => (speed = Number(choice.value)));
    const length = frames.at[last]! - frames.at[0]!;
    if (length < 2) {
      speed = length < 0.5 ? 0.1 : 0.25;
      choice.value = String(speed);
    }
    row.append(button('|‹', 'To the start', () => { pause(); go(0); }), button('‹', 'A step back', () => step(-1)), play,
      button('›', 'A step on', () => step(1)), choice);
    const tip = this.tipAt();
    if (tip !== null) {
      const label = element('label', 'follow'), box = element('input', '');
      box.type = 'checkbox';
      box.addEventListener('change', () => {
        this.follows = box.checked;
        if (box.checked) this.view.centre(this.tipAt()!, this.sizeOfPath());
        else this.view.reset();
      });
      label.append(box, 'follow the tool');
      row.append(label);
    }
    return row;
  }

  /** Where the tool is, where the scene has a dot at its tip. */
  private tipAt(): [number, number, number] | null {
    const tip = this.lines.find((l) => l.data.moves && l.data.layer === 'tool tip' && l.points.length === 3);
    return tip === undefined ? null : [tip.points[0]!, tip.points[1]!, tip.points[2]!];
  }
  /** Of the box round the lines of a program. */
  private sizeOfPath(): number {
    const low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
    for (const line of this.lines) {
      if (line.data.tag === undefined) continue;
      line.points.forEach((x, i) => {
        low[i % 3] = Math.min(low[i % 3]!, Number.isFinite(x) ? x : Infinity);
        high[i % 3] = Math.max(high[i % 3]!, Number.isFinite(x) ? x : -Infinity);
      });
    }
    const size = Math.hypot(...[0, 1, 2].map((k) => high[k]! - low[k]!));
    return Number.isFinite(size) && size > 0 ? 1.2 * size : Math.hypot(...[0, 1, 2].map((k) => this.data.high[k]! - this.data.low[k]!));
  }

  /** Other lines in the place of those that are shown. */
  setLines(lines: LineData[]): void {
    const before = this.lines;
    this.lines = lines.map((data, k) => {
      const old = before[k];
      if (old?.becomes(data)) return old;
      const line = new Line(data, null, this.pixels);
      this.scene.add(line.object);
      line.resize(this.width, this.tall);
      return line;
    });
    for (const line of before) {
      if (this.lines.includes(line)) continue;
      this.scene.remove(line.object);
      line.dispose();
    }
    for (const line of this.lines) line.object.visible = !this.hidden.has(line.data.layer);
    this.theme();
  }

  /** Another box of axes. */
  setBox(low: Vec, high: Vec): void {
    this.data = { ...this.data, low, high };
    this.box.change(this.data);
    this.view.setBox(low, high);
  }

  /** Another scene in the place of this one, seen from where this one was. */
  setScene(data: SceneData): void {
    for (const { mesh } of this.surfaces) {
      this.scene.remove(mesh);
      mesh.geometry.dispose();
    }
    this.surfaces.length = 0;
    this.hidden.clear();
    this.data = data;
    for (const mesh of data.meshes) this.addMesh(mesh);
    this.box.change(data);
    this.view.setBox(data.low, data.high);
    this.setLines(data.lines);
    this.panel.replaceChildren();
    this.sliders.length = 0;
    this.jumps.length = 0;
    this.follows = false;
    this.height.value.set(-1e30, 1e30);
    this.controls();
  }

  private addMesh(mesh: MeshData): void {
    const surface = surfaceOf(mesh, this.data);
    const object = new Mesh(surface.geometry, surfaceMaterial(mesh.opacity, this.height));
    object.renderOrder = mesh.opacity < 1 ? 2 : 1;
    this.scene.add(object);
    this.surfaces.push({ mesh: object, surface, moving: mesh.shifts === undefined ? null : new Moving(mesh) });
  }

  /** A surface whose points move as the frames go, as the stock under the cutter. */
  private grow(of: { mesh: Mesh; surface: Surface; moving: Moving | null }, at: number): void {
    const points = of.moving?.at(at);
    if (!of.moving || !points) return;
    of.surface = surfaceOf(of.moving.mesh, this.data, points);
    of.mesh.geometry.dispose();
    of.mesh.geometry = of.surface.geometry;
  }

  /** Frame `index` of the frames `of`. */
  show(of: number, index: number): void {
    const frames = this.data.frames[of];
    if (!frames) return;
    const points = (this.framePoints[of] ??= unpacked(frames.points));
    let from = index * (points.length / frames.at.length);
    for (const line of this.lines) {
      if (!line.data.moves) continue;
      line.set(points, from);
      from += line.points.length;
    }
    this.frame = { of, index };
    if (of === 0) for (const each of this.surfaces) this.grow(each, frames.at[index]!);
    this.data.frames.forEach((other, k) => {
      if (k !== of) this.sliders[k]?.set(other.start);
    });
    this.reading.replaceChildren(...frames.columns.map((c) => {
      const entry = element('div', '');
      const value = c.values[index];
      const counts = c.unit === '' && Number.isInteger(value);
      entry.append(element('dt', '', c.name), element('dd', '', value === null || value === undefined ? '–' : `${fixed(value, counts ? 0 : 3)} ${c.unit}`));
      return entry;
    }));
    const text = frames.texts?.[index] ?? '';
    this.text.textContent = text;
    this.text.hidden = frames.texts === undefined;
    if (this.follows) {
      const tip = this.tipAt();
      if (tip !== null && tip.every(Number.isFinite)) this.view.centre(tip);
    }
    if (frames.plays) document.dispatchEvent(new CustomEvent('polypod:frame', { detail: this.places(frames, index) }));
    const note = frames.notes[index] ?? '';
    this.note.textContent = note;
    this.note.hidden = note === '';
    this.theme();
  }

  /** What a frame reads out, by the titles that axes of curves have. */
  private places(frames: FramesData, index: number): Map<string, number> {
    const out = new Map([[titled(frames.name, frames.unit), frames.at[index]!]]);
    for (const c of frames.columns) {
      const value = c.values[index];
      if (value !== null && value !== undefined) out.set(titled(c.name, c.unit), value);
    }
    return out;
  }

  /** A place that is picked on a curve, or a line that is picked anywhere, moves what plays to it. */
  private linking(): void {
    const go = (title: string, value: number): void => this.data.frames.forEach((frames, k) => {
      const column = frames.columns.find((c) => titled(c.name, c.unit) === title);
      const values = titled(frames.name, frames.unit) === title ? frames.at : column?.values;
      const jump = this.jumps[k];
      if (!frames.plays || !values || !jump) return;
      let best = -1, off = Infinity;
      values.forEach((v, i) => {
        if (v === null || !(Math.abs(v - value) < off)) return;
        off = Math.abs(v - value);
        best = i;
      });
      if (best >= 0) jump(best);
    });
    document.addEventListener('polypod:at', (e) => {
      const { title, value } = (e as CustomEvent<{ title: string; value: number }>).detail;
      go(title, value);
    });
    document.addEventListener('polypod:line', (e) => {
      const line = (e as CustomEvent<number | null>).detail;
      if (line !== null) go('line', line);
    });
  }

  /** The stretch of each line that belongs to these lines of the program, thick and in the colour of what is picked. */
  private mark(lines: Set<number>): void {
    if (this.marked) {
      this.scene.remove(this.marked.object);
      this.marked.dispose();
      this.marked = null;
    }
    // Of each line of the program the first path that holds it: feeds and rapids are two.
    const left = new Set(lines), places: number[] = [];
    for (const { data, points } of this.lines) {
      if (data.tag === undefined || left.size === 0) continue;
      const tag = data.tag, own = new Set(tag.filter((t) => left.has(t)));
      if (own.size === 0) continue;
      tag.forEach((t, i) => {
        const kept = own.has(t) || own.has(tag[i + 1] ?? NaN);
        for (let k = 0; k < 3; ++k) places.push(kept ? points[3 * i + k]! : NaN);
      });
      places.push(NaN, NaN, NaN);
      for (const t of own) left.delete(t);
    }
    if (places.length > 0) {
      const points = Float32Array.from(places);
      const data: LineData = { name: '', layer: '', colour: 'orange', stroke: 6, dots: false, moves: false, points: '' };
      this.marked = new Line(data, null, this.pixels, points);
      this.scene.add(this.marked.object);
      this.marked.resize(this.width, this.tall);
    }
    this.theme();
  }

  private theme(): void {
    const style = getComputedStyle(this.figure);
    const of = (name: string): Color => new Color(style.getPropertyValue(`--${name}`).trim() || '#888888');
    this.box.recolour(of('rule'));
    const broken = this.frame !== null && (this.data.frames[this.frame.of]!.notes[this.frame.index] ?? '') !== '';
    this.marked?.recolour(of('orange'));
    for (const line of this.lines) line.recolour(of(broken && line.data.moves && line.data.colour === 'ink' ? 'vermillion' : line.data.colour));
    this.request();
  }

  private resize(): void {
    const width = Math.max(50, this.stage.clientWidth);
    const tall = Math.max(50, this.stage.clientHeight);
    if (width === this.width && tall === this.tall) return;
    this.width = width;
    this.tall = tall;
    this.renderer.setSize(width, tall, false);
    for (const line of this.lines) line.resize(width, tall);
    this.marked?.resize(width, tall);
    this.view.resize(width, tall);
  }

  private request(): void {
    if (this.waiting) return;
    this.waiting = true;
    requestAnimationFrame(() => {
      this.waiting = false;
      this.draw();
    });
  }
  private draw(still = false): void {
    const since = performance.now() - this.drawn, moves = !still && since < 200; // ms
    this.sharpen(moves ? this.coarse : 1);
    this.view.camera.updateMatrixWorld(true);
    this.box.update(this.view, this.width, this.tall);
    const begin = performance.now();
    this.renderer.render(this.scene, this.view.camera);
    // Where pictures take longer than 30 a second leave them, as without a graphics card, those that move have fewer
    // pixels; the last one has all of them.
    if (moves && ++this.moved % 6 === 0) {
      const gl = this.renderer.getContext();
      gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4)); // waits for the picture
      const took = performance.now() - begin;
      if (took > 25) this.coarse = Math.max(0.4, 0.8 * this.coarse);
      else if (took < 8) this.coarse = Math.min(1, 1.25 * this.coarse);
    }
    this.drawn = performance.now();
    window.clearTimeout(this.rest);
    if (this.sharp < 1) this.rest = window.setTimeout(() => this.draw(true), 250);
  }
  /** Draws with this share of the screen's pixels along each side. */
  private sharpen(share: number): void {
    if (share === this.sharp) return;
    this.sharp = share;
    this.renderer.setPixelRatio(share * this.pixels);
    for (const line of this.lines) line.sharpen(share * this.pixels);
  }

  private hover(): void {
    let timer = 0;
    this.canvas.addEventListener('pointermove', (e) => {
      if (e.buttons !== 0) {
        this.tip.hide();
        return;
      }
      window.clearTimeout(timer);
      timer = window.setTimeout(() => {
        const rows = this.read(e.offsetX, e.offsetY);
        if (rows.length > 0) this.tip.show(rows, e.clientX, e.clientY);
        else this.tip.hide();
      }, 20);
    });
    this.canvas.addEventListener('pointerleave', () => {
      window.clearTimeout(timer);
      this.tip.hide();
    });
  }

  /** A click on a path picks its line of the program, everywhere on the page. */
  private picking(): void {
    document.addEventListener('polypod:line', (e) => {
      const line = (e as CustomEvent<number | null>).detail;
      this.mark(new Set(line === null ? [] : [line]));
    });
    document.addEventListener('polypod:stretch', (e) => this.mark(new Set((e as CustomEvent<{ lines: number[] } | null>).detail?.lines ?? [])));
    if (!this.lines.some((l) => l.data.tag !== undefined)) return;
    let at = [0, 0];
    this.canvas.addEventListener('pointerdown', (e) => (at = [e.clientX, e.clientY]));
    this.canvas.addEventListener('pointerup', (e) => {
      if (Math.hypot(e.clientX - at[0]!, e.clientY - at[1]!) > 4) return;
      const row = this.read(e.offsetX, e.offsetY).find((t) => /^line \d+$/.test(t));
      if (row) document.dispatchEvent(new CustomEvent('polypod:pick', { detail: Number(row.slice(5)) }));
    });
  }

  /** What lies under a point of the picture, in words. */
  read(x: number, y: number): string[] {
    const span = Math.max(...[0, 1, 2].map((k) => this.data.high[k]! - this.data.low[k]!));
    const place = (p: Vector3): string => [p.x, p.y, p.z].map((v, k) => `${this.data.axes[k]} ${shown(v, span)}`).join(', ') + ` ${this.data.unit}`;
    const kNear = 7; // px
    let best = kNear, rows: string[] = [];
    const v = new Vector3();
    for (const line of this.lines) {
      if (!line.object.visible || (line.data.name === '' && line.values === null)) continue;
      for (let i = 0; i < line.points.length / 3; ++i) {
        const p = new Vector3().fromArray(line.points, 3 * i);
        v.copy(p).project(this.view.camera);
        const off = Math.hypot(((v.x + 1) / 2) * this.width - x, ((1 - v.y) / 2) * this.tall - y);
        if (!(off < best)) continue;
        best = off;
        rows = [line.data.layer, place(p)].filter((t) => t !== '');
        const colours = this.data.colours;
        if (line.values && colours) rows.push(`${colours.name} ${shown(line.values[i]!, colours.high - colours.low)} ${colours.unit}`);
        const tag = line.data.tag?.[i];
        if (tag !== undefined) rows.push(`line ${tag}`);
      }
    }
    if (rows.length > 0) return rows;
    const ray = new Raycaster();
    ray.setFromCamera(new Vector2((2 * x) / this.width - 1, 1 - (2 * y) / this.tall), this.view.camera);
    for (const hit of ray.intersectObjects(this.surfaces.map((s) => s.mesh).filter((m) => m.visible), false)) {
      if (hit.point.z > this.height.value.y || hit.point.z < this.height.value.x) continue;
      const at = this.surfaces.find((s) => s.mesh === hit.object)!;
      const band = at.surface.band[hit.faceIndex ?? 0]!;
      const name = this.data.kinds[band]?.name;
      return name === undefined ? [place(hit.point)] : [name, place(hit.point)];
    }
    return [];
  }

  private save(): void {
    this.draw();
    // On the ground of the page, with the numbers that stand beside the picture.
    const copy = document.createElement('canvas');
    const scale = this.canvas.width / this.width;
    copy.width = this.canvas.width;
    copy.height = this.canvas.height;
    const pen = copy.getContext('2d')!;
    const style = getComputedStyle(this.figure);
    pen.fillStyle = style.getPropertyValue('--ground').trim() || '#ffffff';
    pen.fillRect(0, 0, copy.width, copy.height);
    pen.drawImage(this.canvas, 0, 0);
    pen.fillStyle = style.getPropertyValue('--muted').trim() || '#555555';
    pen.font = `${11 * scale}px sans-serif`;
    pen.textAlign = 'center';
    pen.textBaseline = 'middle';
    const own = this.stage.getBoundingClientRect();
    for (const label of this.stage.querySelectorAll<HTMLElement>('.labels span')) {
      if (label.hidden) continue;
      const at = label.getBoundingClientRect();
      pen.fillText(label.textContent ?? '', (at.left + at.width / 2 - own.left) * scale, (at.top + at.height / 2 - own.top) * scale);
    }
    const link = document.createElement('a');
    link.href = copy.toDataURL('image/png');
    link.download = 'scene.png';
    link.click();
  }
}
