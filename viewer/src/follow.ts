// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Follows a record that grows: the machine at the newest row, the path of its tip, what the row says. The server keeps
// nothing; each question says how far this page has read.

import type { LineData, SceneData, Vec } from './data';
import { floats } from './packed';

interface Figure {
  name: string;
  unit: string;
}
export interface FollowData {
  address: string;
  record: string;
  pose: Figure[];
  joints: { min: number | null; max: number | null; unit: string }[];
}
interface Row {
  time_s: number;
  line: number;
  pose?: number[];
  joints: number[];
  deviation_um?: number | null;
  violations?: string[];
  reason?: string;
}
interface News {
  error?: string;
  there: boolean;
  anew: boolean;
  next: { from: number; file: string; time_s: number | null };
  rows: number;
  skipped: number;
  unfinished: number;
  refused: number;
  why: string;
  row?: Row;
  scene?: SceneData;
}
interface Picture {
  setLines(lines: LineData[]): void;
  setBox(low: Vec, high: Vec): void;
}

const kPictures = 30; // a second
const kStill = 3; // s without a row, after which that is said
const kMost = 4000; // points of the path that is drawn
const kTrail = 'path of the tip';

function make<K extends keyof HTMLElementTagNameMap>(name: K, content = ''): HTMLElementTagNameMap[K] {
  const out = document.createElement(name);
  if (content !== '') out.textContent = content;
  return out;
}
const wait = (ms: number): Promise<void> => new Promise((done) => window.setTimeout(done, ms));

export function follow(root: HTMLElement, data: FollowData): void {
  const picture = (): Picture | undefined => (window as unknown as { polypodScenes?: Picture[] }).polypodScenes?.[0];
  const figures = make('dl');
  figures.className = 'reading';
  const cells = new Map<string, HTMLElement>();
  const entry = (name: string): void => {
    const row = make('div'), value = make('dd', '–');
    row.append(make('dt', name), value);
    cells.set(name, value);
    figures.append(row);
  };
  const names = ['time', 'line', ...data.pose.map((c) => c.name), 'deviation', ...data.joints.map((_, i) => `q${i + 1}`)];
  names.forEach(entry);
  const told = make('p', 'Waiting for the first row …');
  told.setAttribute('role', 'status');
  const read = make('p');
  read.className = 'still';
  const pause = make('button', 'Pause');
  pause.type = 'button';
  let paused = false;
  pause.addEventListener('click', () => {
    paused = !paused;
    pause.textContent = paused ? 'Go on' : 'Pause';
  });
  root.append(told, figures, read, pause);

  let next: News['next'] = { from: 0, file: '', time_s: null };
  let trail: number[] = [], rows = 0, refused = 0, skipped = 0, why = '';
  let seen = performance.now(); // when the last row came
  let box: { low: Vec; high: Vec } | null = null;
  let broken: string[] = [];
  let machine: LineData[] = []; // where it last was

  const say = (text: string, bad: boolean): void => {
    if (told.textContent !== text) told.textContent = text;
    told.className = bad ? 'note' : '';
  };
  const put = (name: string, value: number | null | undefined, unit: string, decimals: number, beyond = false): void => {
    const cell = cells.get(name)!;
    cell.textContent = value === null || value === undefined ? '–' : `${value.toFixed(decimals)} ${unit}`;
    cell.className = beyond ? 'beyond' : '';
  };
  const show = (row: Row): void => {
    put('time', row.time_s, 's', 3);
    put('line', row.line > 0 ? row.line : null, '', 0);
    data.pose.forEach((c, i) => put(c.name, row.pose?.[i], c.unit, 3));
    put('deviation', row.deviation_um, 'µm', 2);
    data.joints.forEach((j, i) => {
      const q = row.joints[i]!, kRounding = 1e-9;
      put(`q${i + 1}`, q, j.unit, 3, (j.min !== null && q < j.min - kRounding) || (j.max !== null && q > j.max + kRounding));
    });
    broken = row.reason !== undefined ? [row.reason] : (row.violations ?? []);
  };
  const draw = (scene: SceneData): void => {
    const lines = scene.lines.filter((l) => l.layer !== kTrail);
    const added = scene.lines.find((l) => l.layer === kTrail);
    if (added) for (const x of floats(added.points as string)) trail.push(x);
    if (trail.length > 3 * kMost) trail = trail.filter((_, i) => Math.floor(i / 3) % 2 === 0);
    const all: LineData = { name: kTrail, layer: kTrail, colour: 'green', stroke: 2.4, dots: false, moves: false, points: Float32Array.from(trail) };
    const shown = picture();
    if (!shown) return;
    shown.setLines([...(lines.length > 0 ? lines : machine), ...(trail.length > 3 ? [all] : [])]);
    if (lines.length === 0) return;
    machine = lines;
    // The box of axes begins with the first row, and grows with what leaves it.
    const leaves = box === null || [0, 1, 2].some((k) => scene.low[k]! < box!.low[k]! || scene.high[k]! > box!.high[k]!);
    if (!leaves) return;
    const low = [...scene.low] as Vec, high = [...scene.high] as Vec;
    for (const k of [0, 1, 2]) {
      const kMore = 0.05, more = kMore * (high[k]! - low[k]!);
      if (box === null) continue;
      low[k] = low[k]! < box.low[k]! ? low[k]! - more : box.low[k]!;
      high[k] = high[k]! > box.high[k]! ? high[k]! + more : box.high[k]!;
    }
    box = { low, high };
    shown.setBox(low, high);
  };

  const apply = (news: News): void => {
    if (news.error !== undefined) {
      say(news.error, true);
      return;
    }
    if (news.anew) {
      trail = [];
      rows = refused = skipped = 0;
      why = '';
      broken = [];
      box = null;
      seen = performance.now();
      for (const cell of cells.values()) cell.textContent = '–';
    }
    next = news.next;
    rows += news.rows;
    refused += news.refused;
    skipped += news.skipped;
    if (why === '') why = news.why;
    if (news.row) {
      seen = performance.now();
      show(news.row);
    }
    if (news.scene) draw(news.scene);
    const still = (performance.now() - seen) / 1000;
    const limits = broken.length === 0 ? 'Within all limits.' : `Not within the limits: ${broken.join(', ')}.`;
    if (rows === 0) {
      say(news.there ? 'The record has no rows yet: waiting for the first.' : 'The record is not there yet, or its first line has no end: waiting.', false);
    } else if (still > kStill) {
      const end = news.unfinished > 0 ? ` Its last line has no end yet (${news.unfinished} bytes).` : '';
      say(`No new row for ${Math.floor(still)} s.${end} At the last row: ${limits}`, broken.length > 0);
    } else {
      say(limits, broken.length > 0);
    }
    const parts = [`${rows} rows read`];
    if (skipped > 0) parts.push(`${Math.ceil(skipped / 1000)} kB before them left out`);
    if (refused > 0) parts.push(`${refused} rows that cannot be read left out (${why})`);
    read.textContent = `${parts.join('; ')}.`;
  };

  void (async () => {
    let due = performance.now();
    for (;;) {
      if (!paused && !document.hidden) {
        try {
          const done = await fetch(`${data.address}/rows`, { method: 'POST', headers: { 'Content-Type': 'application/json' }, body: JSON.stringify(next) });
          const news = (await done.json()) as News;
          if (!paused) apply(news); // what came after the click is asked for again
        } catch (error) {
          say(`The program does not answer any more: ${String(error)}`, true);
          await wait(1000);
        }
      }
      due = Math.max(due + 1000 / kPictures, performance.now());
      await wait(due - performance.now());
    }
  })();
}
