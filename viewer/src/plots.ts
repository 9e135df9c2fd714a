// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Plots: what stands under the pointer, a stretch of the x axis that is dragged, and the values of a plot as a table.
// The attributes are written by src/report: `data-plot` says what kind of plot it is ("curves", "bins", "map", "plane",
// "parallel"), `data-x` and `data-y` are its scales (from, to, and where these are in the picture).

import { figure, shown } from './numbers';
import { floats, octets } from './packed';

export interface Tip {
  show(rows: string[], x: number, y: number): void;
  hide(): void;
}
type Pair = [number, number];

const five = (value: number): string => figure(value, 5);
const kNear = 8; // px: how far the pointer may be from a line or a dot that it reads

interface Scale {
  (value: number): number;
  back(px: number): number;
  inside(px: number): boolean;
  low: number;
  high: number;
  span(value: number): number; // over which values change as they do there
  from: number; // px
  to: number;
}
function scaleOf(text: string | undefined): Scale {
  const words = (text ?? '').split(' ');
  const [a = 0, b = 1, p = 0, q = 1] = words.slice(0, 4).map(Number), log = words[4] === 'log';
  const ratio = Math.log(b / a);
  const scale = (value: number): number => p + (log ? Math.log(value / a) / ratio : (value - a) / (b - a)) * (q - p);
  return Object.assign(scale, {
    back: (px: number) => (log ? a * Math.exp(((px - p) / (q - p)) * ratio) : a + ((px - p) / (q - p)) * (b - a)),
    inside: (px: number) => px >= Math.min(p, q) && px <= Math.max(p, q),
    low: Math.min(a, b), high: Math.max(a, b), span: (value: number) => (log ? value * Math.abs(ratio) : Math.abs(b - a)), from: p, to: q,
  });
}

/** The drawing that holds the values: a narrow one stands beside a wide one that has them. */
function holder(svg: SVGSVGElement): SVGSVGElement {
  if (!svg.closest('.narrow')) return svg;
  return svg.closest('figure')?.querySelector<SVGSVGElement>('.wide svg[data-plot]') ?? svg;
}

export interface Curve {
  name: string;
  dots: boolean; // at the points, without a line through them
  values: Pair[] | null;
  runs: number[][][]; // px; of dots each alone
}
export function curvesOf(svg: SVGSVGElement): Curve[] {
  const drawn = 'path[data-name],path[data-dots]';
  const own = [...svg.querySelectorAll<SVGPathElement>(drawn)], wide = [...holder(svg).querySelectorAll<SVGPathElement>(drawn)];
  return own.map((path, k) => {
    const { v, f } = (wide[k] ?? path).dataset;
    let values: Pair[] | null = v?.split(';').map((p) => (p === '-' ? [NaN, NaN] : p.split(',').map(Number)) as Pair) ?? null;
    if (f !== undefined) {
      const packed = floats(f);
      values = Array.from({ length: packed.length / 2 }, (_, i) => [packed[2 * i]!, packed[2 * i + 1]!] as Pair);
    }
    const d = path.getAttribute('d') ?? '';
    const runs = /[VHZz]/.test(d) ? [] : d.split('M').filter(Boolean).map((run) => run.split('L').map((point) => point.split(' ').map(parseFloat)));
    const { name, dots } = path.dataset;
    return { name: name ?? dots ?? '', dots: dots !== undefined, values, runs };
  });
}

interface Grid {
  columns: number;
  rows: number;
  x: Pair;
  y: Pair;
  values: Float32Array;
  kinds: Uint8Array | null;
  names: string[];
  what: string;
  unit: string;
}
function gridOf(svg: SVGSVGElement): Grid | null {
  const { grid, f, k, kinds, value, unit } = holder(svg).dataset;
  if (grid === undefined || f === undefined) return null;
  const [columns = 0, rows = 0, x0 = 0, x1 = 1, y0 = 0, y1 = 1] = grid.split(' ').map(Number);
  return {
    columns, rows, x: [x0, x1], y: [y0, y1], values: floats(f), kinds: k === undefined ? null : octets(k),
    names: (kinds ?? '').split(';'), what: value ?? '', unit: unit ?? '',
  };
}
const along = (range: Pair, i: number, count: number): number => range[0] + (count > 1 ? (i / (count - 1)) * (range[1] - range[0]) : 0);

/** Parallel coordinates: axes side by side (or one below the other, `across`), and lines over all of them. */
interface Parallel {
  across: boolean;
  places: number[]; // px
  scales: Scale[];
  names: string[];
  lines: { group: string; values: number[] }[];
}
function parallelOf(svg: SVGSVGElement): Parallel {
  const axes = (svg.dataset['axes'] ?? '').split(';').map((axis) => axis.split(' '));
  const names = (svg.dataset['names'] ?? '').split('|');
  const lines = [...holder(svg).querySelectorAll<SVGPathElement>('path[data-group]')].flatMap((path) => {
    const all = [...floats(path.dataset['f'] ?? '')], n = names.length;
    return Array.from({ length: all.length / n }, (_, k) => ({ group: path.dataset['group'] ?? '', values: all.slice(k * n, (k + 1) * n) }));
  });
  return { across: svg.dataset['across'] !== undefined, places: axes.map((axis) => Number(axis[0])), scales: axes.map((axis) => scaleOf(axis.slice(1).join(' '))), names, lines };
}

/** The values of a plot as the rows of a table, the first its head; null where it has none. */
export function tableOf(svg: SVGSVGElement): (string | number)[][] | null {
  const label = svg.dataset['label'] || 'x', yname = svg.dataset['yname'] || 'y';
  if (svg.dataset['plot'] === 'map') {
    const grid = gridOf(svg);
    if (grid === null) return null;
    const rows: (string | number)[][] = [[label, yname, [grid.what || 'value', grid.unit].filter(Boolean).join(', '), ...(grid.kinds ? ['kind'] : [])]];
    grid.values.forEach((v, n) => {
      if (!Number.isFinite(v)) return;
      const kind = grid.kinds ? [grid.names[grid.kinds[n]!] ?? ''] : [];
      rows.push([Number(along(grid.x, n % grid.columns, grid.columns).toPrecision(9)), Number(along(grid.y, Math.floor(n / grid.columns), grid.rows).toPrecision(9)), Number(v.toPrecision(7)), ...kind]);
    });
    return rows;
  }
  if (svg.dataset['plot'] === 'parallel') {
    const { names, lines } = parallelOf(svg);
    return [['group', ...names], ...lines.map((line) => [line.group, ...line.values.map((v) => Number(v.toPrecision(7)))])];
  }
  const curves = curvesOf(svg).filter((c) => c.values !== null);
  if (curves.length === 0) return null;
  const rows: (string | number)[][] = [['curve', label, yname]];
  for (const c of curves) for (const [x, y] of c.values!) if (Number.isFinite(x)) rows.push([c.name, Number(x.toPrecision(9)), Number(y.toPrecision(9))]);
  return rows;
}

/** The points of a curve whose x is nearest to the given one, where that is within its range. */
function nearest(values: Pair[], x: number): Pair[] {
  let best: Pair[] = [];
  let low = Infinity, high = -Infinity;
  for (const point of values) {
    if (!Number.isFinite(point[0])) continue;
    low = Math.min(low, point[0]);
    high = Math.max(high, point[0]);
    const closer = best.length === 0 ? 1 : Math.abs(best[0]![0] - x) - Math.abs(point[0] - x);
    if (closer > 0) best = [point];
    else if (point[0] === best[0]![0]) best.push(point);
  }
  return x < low || x > high ? [] : best;
}

/** A part of the x axis with a name, as a line of the program. */
interface Part {
  name: string;
  line: number;
  from: number;
  to: number;
}
/** A stretch of an x axis that was dragged over, in every plot with that axis. */
export interface Stretch {
  title: string;
  from: number;
  to: number;
  lines: number[];
}

export class Plot {
  readonly kind: string;
  readonly title: string;
  readonly X: Scale;
  readonly Y: Scale;
  readonly parts: Part[];
  private curves_: Curve[] | null = null;
  private grid_: Grid | null | undefined;
  private parallel_: Parallel | undefined;

  constructor(readonly svg: SVGSVGElement) {
    this.kind = svg.dataset['plot'] ?? '';
    this.title = svg.dataset['label'] ?? '';
    this.X = scaleOf(svg.dataset['x']);
    this.Y = scaleOf(svg.dataset['y']);
    this.parts = (holder(svg).dataset['spans'] ?? '').split(';').filter(Boolean).map((part) => {
      const [name, from, to] = part.split(':');
      return { name: name ?? '', line: Number(/^line (\d+)$/.exec(name ?? '')?.[1] ?? NaN), from: Number(from), to: Number(to) };
    });
  }
  get curves(): Curve[] {
    return (this.curves_ ??= curvesOf(this.svg));
  }
  get hasAxis(): boolean {
    return this.kind === 'curves';
  }

  /** Where the pointer is in the picture, px of the drawing. */
  at(e: MouseEvent): Pair {
    const box = this.svg.getBoundingClientRect();
    return [((e.clientX - box.left) * this.svg.viewBox.baseVal.width) / box.width, ((e.clientY - box.top) * this.svg.viewBox.baseVal.height) / box.height];
  }
  /** The value on the x axis under the pointer. */
  valueAt(e: MouseEvent): number | null {
    const [x] = this.at(e);
    return this.X.inside(x) ? this.X.back(x) : null;
  }
  partAt(v: number): Part | undefined {
    return this.parts.find((s) => s.from <= v && v <= s.to);
  }

  /** What stands under the pointer, in words. */
  read(e: MouseEvent): string[] {
    const [x, y] = this.at(e);
    if (this.kind === 'parallel') return this.readParallel(x, y);
    if (!this.X.inside(x)) return [];
    if (this.kind === 'map') return this.Y.inside(y) ? this.readMap(x, y, e) : [];
    if (this.kind === 'plane') return this.Y.inside(y) ? this.readPlane(x, y, e) : [];
    return this.readCurves(x, y);
  }

  /** The dots of a series: their values, and where they are in the picture. Without values they are read off it. */
  private dotsOf(curve: Curve): { at: Pair; value: Pair }[] {
    if (curve.values === null) return curve.runs.map(([dot]) => ({ at: dot as Pair, value: [this.X.back(dot![0]!), this.Y.back(dot![1]!)] }));
    const inside = ([x, y]: Pair): boolean => this.X.inside(x) && this.Y.inside(y);
    return curve.values.map((value) => ({ at: [this.X(value[0]), this.Y(value[1])] as Pair, value })).filter(({ at }) => inside(at));
  }

  /** Every curve at the place of the pointer, or of the dot that it is on; dots that are above or below that place. */
  private readCurves(x: number, y: number): string[] {
    const unit = this.svg.dataset['unit'] ?? '';
    const dots = this.curves.map((curve) => (curve.dots ? this.dotsOf(curve) : []));
    let on: { at: Pair; value: Pair } | null = null, best = kNear;
    for (const dot of dots.flat()) {
      const off = Math.hypot(dot.at[0] - x, dot.at[1] - y);
      if (!(off <= best)) continue; // of equal ones the last, which is drawn on top
      best = off;
      on = dot;
    }
    const px = on === null ? x : on.at[0], v = on === null ? this.X.back(x) : on.value[0];
    const told: { text: string; x: number }[] = [];
    this.curves.forEach((curve, k) => {
      const says = (what: string, at: number): void => void told.push({ text: `${curve.name || this.svg.dataset['yname']}: ${what} ${unit}`.trimEnd(), x: at });
      if (curve.dots) {
        const beside = ({ at }: { at: Pair }): number => Math.abs(at[0] - px);
        const order = (a: { at: Pair }, b: { at: Pair }): number => beside(a) - beside(b) || Math.abs(a.at[1] - y) - Math.abs(b.at[1] - y);
        const dot = on !== null && dots[k]!.includes(on) ? on : dots[k]!.filter((d) => beside(d) <= kNear).sort(order)[0];
        if (dot) says(curve.values === null ? `about ${shown(dot.value[1], 10 * this.Y.span(dot.value[1]))}` : figure(dot.value[1], 6), dot.value[0]);
        return;
      }
      if (curve.values !== null) {
        const points = nearest(curve.values, v).filter((p) => Number.isFinite(p[1])), all = points.map((p) => p[1]);
        if (points.length === 0) return;
        const [low, high] = [Math.min(...all), Math.max(...all)].map((w) => figure(w, 6));
        says(low === high ? low! : `${low} to ${high}`, points[0]![0]);
        return;
      }
      curve.runs.some((run) => {
        for (let i = 1; i < run.length; ++i) {
          const a = run[i - 1]!, b = run[i]!;
          if (a[0]! > px || px > b[0]!) continue;
          const t = b[0]! > a[0]! ? (px - a[0]!) / (b[0]! - a[0]!) : 0;
          const value = this.Y.back(a[1]! + t * (b[1]! - a[1]!));
          says(`about ${shown(value, 10 * this.Y.span(value))}`, v); // 10: a digit less
          return true;
        }
        return false;
      });
    });
    const place = (at: number): string => shown(at, this.X.span(at));
    const at = place(on !== null ? v : (told[told.length - 1]?.x ?? v));
    const rows = [`${this.title}: ${at}`, ...told.map((row) => (place(row.x) === at ? row.text : `${row.text} at ${place(row.x)}`))];
    const part = this.partAt(v);
    if (part) rows.push(part.name);
    return rows;
  }

  /** The value at the point of the grid that is nearest. */
  private readMap(x: number, y: number, e: MouseEvent): string[] {
    const told = (e.target as Element | null)?.closest<SVGElement>('[data-tip]')?.dataset['tip'];
    const grid = (this.grid_ ??= gridOf(this.svg));
    const rows = told === undefined ? [] : [told];
    if (!grid) return rows;
    const index = (range: Pair, value: number, count: number): number => Math.max(0, Math.min(count - 1, Math.round(((value - range[0]) / (range[1] - range[0] || 1)) * (count - 1))));
    const i = index(grid.x, this.X.back(x), grid.columns), j = index(grid.y, this.Y.back(y), grid.rows);
    const value = grid.values[j * grid.columns + i]!;
    rows.push(`${this.title}: ${shown(along(grid.x, i, grid.columns), this.X.span(0))}`, `${this.svg.dataset['yname']}: ${shown(along(grid.y, j, grid.rows), this.Y.span(0))}`);
    if (!Number.isFinite(value)) return [...rows, 'no value here'];
    if (grid.what !== '' || grid.kinds === null) rows.push(`${grid.what || 'value'}: ${five(value)} ${grid.unit}`.trimEnd());
    const kind = grid.kinds === null ? undefined : grid.names[grid.kinds[j * grid.columns + i]!];
    if (kind) rows.push(kind);
    return rows;
  }

  /** The line of parallel coordinates that is nearest: its value on each axis. */
  private readParallel(x: number, y: number): string[] {
    const { across, places, scales, names, lines } = (this.parallel_ ??= parallelOf(this.svg));
    const [along, at] = across ? [y, x] : [x, y];
    const i = Math.max(1, places.findIndex((place) => place >= along));
    if (!(along >= places[0]! && along <= places[places.length - 1]!)) return [];
    const t = (along - places[i - 1]!) / (places[i]! - places[i - 1]!);
    let best = kNear;
    let found: (typeof lines)[number] | null = null;
    for (const line of lines) {
      const a = scales[i - 1]!(line.values[i - 1]!), b = scales[i]!(line.values[i]!);
      const off = Math.abs(a + t * (b - a) - at);
      if (!(off <= best)) continue; // of equal lines the last, which is drawn on top
      best = off;
      found = line;
    }
    return found === null ? [] : [found.group, ...names.map((name, k) => `${name}: ${five(found.values[k]!)}`)];
  }

  /** The nearest line or dot, and the areas: positions to what a pixel tells. */
  private readPlane(x: number, y: number, e: MouseEvent): string[] {
    let best = kNear, at: Pair = [x, y], name: string | null = null;
    const near = (p: Pair, what: string): void => {
      const off = Math.hypot(p[0] - x, p[1] - y);
      if (!(off < best)) return;
      best = off;
      at = p;
      name = what;
    };
    for (const curve of this.curves) {
      for (const run of curve.runs) {
        if (curve.dots) near(run[0] as Pair, curve.name);
        for (let i = 1; i < run.length; ++i) {
          const [ax, ay] = run[i - 1] as Pair, [bx, by] = run[i] as Pair;
          const length = (bx - ax) ** 2 + (by - ay) ** 2;
          const t = length > 0 ? Math.max(0, Math.min(1, ((x - ax) * (bx - ax) + (y - ay) * (by - ay)) / length)) : 0;
          near([ax + t * (bx - ax), ay + t * (by - ay)], curve.name);
        }
      }
    }
    const pixel = 1000 * Math.abs(this.X.back(1) - this.X.back(0));
    const rows = [`${this.title}: ${shown(this.X.back(at[0]), pixel)}`, `${this.svg.dataset['yname']}: ${shown(this.Y.back(at[1]), pixel)}`];
    if (name) rows.unshift(name);
    const areas = document.elementsFromPoint(e.clientX, e.clientY).map((part) => (part as SVGElement).dataset?.['area']).filter((area): area is string => !!area);
    return [...rows, ...new Set(areas)];
  }

  /** Least and greatest value of each curve over a stretch. */
  over(from: number, to: number): string[] {
    const unit = this.svg.dataset['unit'] ?? '';
    return this.curves.flatMap((curve) => {
      const inside = (curve.values ?? []).filter(([x, y]) => x >= from && x <= to && Number.isFinite(y)).map(([, y]) => y);
      if (inside.length === 0) return [];
      const low = Math.min(...inside), high = Math.max(...inside);
      return [`${curve.name || this.svg.dataset['yname']}: ${five(low)} to ${five(high)} ${unit}`.trimEnd()];
    });
  }

  /** A mark over a part of the x axis, behind the curves. */
  mark(from: number, to: number, name: string): SVGRectElement {
    const mark = document.createElementNS(this.svg.namespaceURI, 'rect') as SVGRectElement;
    const a = this.X(Math.max(from, this.X.low)), b = this.X(Math.min(to, this.X.high));
    mark.setAttribute('x', String(Math.min(a, b)));
    mark.setAttribute('width', String(Math.max(1, Math.abs(b - a))));
    mark.setAttribute('y', String(this.Y.to));
    mark.setAttribute('height', String(this.Y.from - this.Y.to));
    mark.setAttribute('class', name);
    this.svg.prepend(mark);
    return mark;
  }
}

/** What every plot of the page shows: values under the pointer, cursors of what plays, stretches. */
export function readPlots(tip: Tip): Plot[] {
  const plots = [...document.querySelectorAll<SVGSVGElement>('svg[data-plot]')].map((svg) => new Plot(svg));
  for (const plot of plots) {
    const { svg } = plot;
    svg.addEventListener('pointermove', (e) => {
      if (dragging !== null) return;
      const rows = plot.read(e);
      if (rows.length > 0) tip.show(rows, e.clientX, e.clientY);
      else tip.hide();
    });
    svg.addEventListener('pointerleave', () => tip.hide());
    if (plot.hasAxis) drags(plot, plots, tip);
  }
  for (const part of document.querySelectorAll<SVGElement>('svg:not([data-plot]) [data-tip]')) {
    part.addEventListener('pointermove', (e) => tip.show([part.dataset['tip'] ?? ''], e.clientX, e.clientY));
    part.addEventListener('pointerleave', () => tip.hide());
  }
  document.addEventListener('keydown', (e) => {
    if (e.key === 'Escape') choose(null, plots);
  });
  return plots;
}

let dragging: Plot | null = null;
const marks: Element[] = [];
function choose(stretch: Stretch | null, plots: Plot[]): void {
  for (const mark of marks.splice(0)) mark.remove();
  if (stretch !== null) {
    for (const plot of plots) {
      if (!plot.hasAxis || plot.title !== stretch.title || stretch.to < plot.X.low || stretch.from > plot.X.high) continue;
      marks.push(plot.mark(stretch.from, stretch.to, 'stretch'));
      if (plot.svg.closest('.narrow')) continue;
      const told = document.createElement('p');
      told.className = 'stretch';
      told.setAttribute('role', 'status');
      const ends = [stretch.from, stretch.to].map((v) => shown(v, plot.X.span(v))).join(' to ');
      told.textContent = [`${stretch.title}: ${ends}`, ...plot.over(stretch.from, stretch.to)].join('; ') + '. ';
      const clear = document.createElement('button');
      clear.type = 'button';
      clear.textContent = 'Clear';
      clear.addEventListener('click', () => choose(null, plots));
      told.append(clear);
      (plot.svg.closest('.wide') ?? plot.svg).after(told);
      marks.push(told);
    }
  }
  document.dispatchEvent(new CustomEvent('polypod:stretch', { detail: stretch }));
}

/** Dragging along the x axis chooses a stretch; a click leaves it. */
function drags(plot: Plot, plots: Plot[], tip: Tip): void {
  const { svg } = plot;
  let from: number | null = null, mark: Element | null = null, start = 0;
  const within = (e: MouseEvent): number => plot.X.back(Math.max(plot.X.from, Math.min(plot.X.to, plot.at(e)[0])));
  const end = (): void => {
    mark?.remove();
    mark = null;
    from = null;
    dragging = null;
  };
  svg.addEventListener('pointerdown', (e) => {
    if (e.button !== 0 || e.pointerType === 'touch') return;
    from = plot.valueAt(e);
    start = e.clientX;
  });
  svg.addEventListener('pointermove', (e) => {
    if (from === null || (dragging === null && Math.abs(e.clientX - start) < 5)) return;
    if (dragging === null) {
      dragging = plot;
      svg.setPointerCapture(e.pointerId);
    }
    const to = within(e);
    mark?.remove();
    mark = plot.mark(Math.min(from, to), Math.max(from, to), 'stretch');
    tip.show([`${plot.title}: ${[Math.min(from, to), Math.max(from, to)].map((v) => shown(v, plot.X.span(v))).join(' to ')}`], e.clientX, e.clientY);
  });
  svg.addEventListener('pointerup', (e) => {
    if (dragging !== plot || from === null) {
      from = null;
      return;
    }
    const to = within(e), low = Math.min(from, to), high = Math.max(from, to);
    const lines = plot.parts.filter((p) => Number.isFinite(p.line) && p.to >= low && p.from <= high).map((p) => p.line);
    end();
    tip.hide();
    // The click that ends a drag picks nothing.
    svg.addEventListener('click', (click) => click.stopImmediatePropagation(), { capture: true, once: true });
    choose({ title: plot.title, from: low, to: high, lines: [...new Set(lines)] }, plots);
  });
  svg.addEventListener('pointercancel', end);
}
