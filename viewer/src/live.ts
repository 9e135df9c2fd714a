// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What `polypod view` serves: the form of a machine, where every figure that is typed is asked of the library in the
// server, and records that grow (follow.ts).

import { follow, type FollowData } from './follow';

interface Setting {
  key: string;
  name: string; // the key without its unit, as the page lists it
  value: number;
  unit: string;
  single: boolean; // a parameter of one part alone
}
interface Joint {
  value: number;
  min: number | null;
  max: number | null;
  unit: string;
}
interface LiveData {
  address: string;
  file: string; // of the machine, or its name in the catalogue
  settings: Setting[];
  pose: { name: string; value: number; unit: string; low: number; high: number }[];
  joints: Joint[];
  turns: boolean;
}
interface Picture {
  setLines(lines: unknown[]): void;
  setScene(scene: unknown): void;
}
interface Answer {
  error?: string;
  scene?: { lines: unknown[] };
  pose?: number[];
  joints?: number[];
  violations?: string[];
  reason?: string;
  condition?: number | null;
  sigma_min?: number | null;
  volume?: string;
}

const host = document.getElementById('live');
const text = document.getElementById('live-data')?.textContent;

function make<K extends keyof HTMLElementTagNameMap>(name: K, content = ''): HTMLElementTagNameMap[K] {
  const out = document.createElement(name);
  if (content !== '') out.textContent = content;
  return out;
}

function start(root: HTMLElement, data: LiveData): void {
  const kDigits = 9; // of a figure in a field
  const sets: Record<string, string> = {};
  // The same figures stand in a list of the page, as the file has them.
  const inFile = new Map<string, { shown: Element; text: string }>();
  for (const name of document.querySelectorAll('main dt')) {
    const shown = name.nextElementSibling, key = name.textContent ?? '';
    if (shown && data.settings.some((s) => s.name === key)) inFile.set(key, { shown, text: shown.textContent ?? '' });
  }
  const listed = (): void => {
    for (const s of data.settings) {
      const now = inFile.get(s.name), set = sets[s.key];
      if (now) now.shown.textContent = set === undefined ? now.text : `${Number(Number(set).toPrecision(6))} ${s.unit} (${now.text} in the file)`;
    }
  };
  const picture = (): Picture | undefined => (window as unknown as { polypodScenes?: Picture[] }).polypodScenes?.[0];
  const told = make('p');
  told.setAttribute('role', 'status');
  const figures = make('dl');
  const volume = make('p');
  volume.setAttribute('role', 'status');

  const group = (title: string): HTMLElement => {
    const set = make('fieldset'), fields = make('div');
    fields.className = 'fields';
    set.append(make('legend', title), fields);
    root.append(set);
    return fields;
  };
  const field = (name: string, unit: string, value: number, low: number | null, high: number | null, slides: boolean, changed: (v: number) => void): { set(v: number): void } => {
    const label = make('label'), input = make('input');
    label.className = slides ? 'wide' : '';
    input.type = 'number';
    input.step = 'any';
    input.setAttribute('aria-label', `${name}, ${unit}`);
    const range = make('input');
    const put = (v: number): void => {
      input.value = String(Number(v.toPrecision(kDigits)));
      range.value = String(v);
    };
    label.append(make('span', name));
    if (slides && low !== null && high !== null) {
      range.type = 'range';
      range.min = String(low);
      range.max = String(high);
      range.step = String((high - low) / 1000);
      range.setAttribute('aria-label', name);
      range.addEventListener('input', () => {
        input.value = String(Number(Number(range.value).toPrecision(6)));
        changed(Number(range.value));
      });
      label.append(range);
    } else if (slides) {
      label.append(make('span'));
    }
    input.addEventListener('input', () => {
      const v = Number(input.value);
      if (input.value.trim() === '' || !Number.isFinite(v)) return;
      range.value = input.value;
      changed(v);
    });
    label.append(input, make('span', unit));
    put(value);
    lastGroup.append(label);
    return { set: put };
  };

  let lastGroup = group('Pose');
  const pose = data.pose.map((c) => c.value);
  const poseFields = data.pose.map((c, i) => field(c.name, c.unit, c.value, c.low, c.high, true, (v) => {
    pose[i] = v;
    ask({ pose });
  }));
  lastGroup = group('Joints');
  const joints = data.joints.map((j) => j.value);
  const jointFields = data.joints.map((j, i) => field(`q${i + 1}`, j.unit, j.value, j.min, j.max, true, (v) => {
    joints[i] = v;
    ask({ joints });
  }));
  root.append(figures, told);
  for (const single of [false, true]) {
    const settings = data.settings.filter((s) => s.single === single);
    if (settings.length === 0) continue;
    lastGroup = group(single ? 'Every part by itself' : 'Figures of the machine');
    if (single && settings.length < data.settings.length) {
      const more = make('details'), fields = lastGroup;
      more.append(make('summary', `${settings.length} figures`));
      fields.replaceWith(more);
      more.append(fields);
    }
    for (const s of settings) {
      field(s.key, s.unit, s.value, null, null, false, (v) => {
        if (v === Number(s.value.toPrecision(kDigits))) delete sets[s.key];
        else sets[s.key] = String(v);
        const changes = Object.entries(sets).map(([key, value]) => ` --set '${key}=${value}'`).join('');
        const file = /^[\w./-]+$/.test(data.file) ? data.file : `'${data.file.replace(/'/g, `'\\''`)}'`;
        kept.textContent = `polypod info ${file}${changes} -o changed.toml`;
        keep.hidden = changes === '';
        ask({ pose });
        later();
      });
    }
  }
  const keep = make('p', 'The command that keeps the changed machine: '), kept = make('code');
  keep.hidden = true;
  keep.append(kept);
  root.append(keep);
  lastGroup = group('Workspace');
  let tilt = 0;
  if (data.turns) {
    field('tilt of the tool in every direction', 'deg', 0, null, null, false, (v) => {
      tilt = v;
      later();
    });
  }
  const button = make('button', 'Compute the workspace');
  button.type = 'button';
  button.addEventListener('click', () => void workspace());
  const cancel = make('button', 'Cancel');
  cancel.type = 'button';
  cancel.hidden = true;
  cancel.addEventListener('click', () => {
    wanted = false;
    running?.abort();
    void post('cancel', { client });
  });
  lastGroup.append(button, cancel);
  root.append(volume);

  async function post(what: string, body: unknown, signal?: AbortSignal): Promise<Answer> {
    const done = await fetch(`${data.address}/${what}`, { method: 'POST', headers: { 'Content-Type': 'application/json' }, body: JSON.stringify(body), signal: signal ?? null });
    return (await done.json()) as Answer;
  }
  const show = (answer: Answer): void => {
    if (answer.error !== undefined) {
      told.textContent = answer.error;
      told.className = 'note';
      figures.replaceChildren(); // they are of the machine before
      return;
    }
    listed();
    const broken = answer.reason ? [answer.reason] : (answer.violations ?? []);
    told.textContent = broken.length === 0 ? 'Within all limits.' : `Not within the limits: ${broken.join(', ')}.`;
    told.className = broken.length === 0 ? '' : 'note';
    if (answer.scene && answer.scene.lines.length > 0) picture()?.setLines(answer.scene.lines);
    const rows: [string, string][] = [];
    const value = (v: number | null | undefined): string => (v === null || v === undefined ? 'infinite' : String(Number(v.toPrecision(5))));
    if (!answer.reason) rows.push(['condition of the Jacobian', value(answer.condition)], ['least singular value', value(answer.sigma_min)]);
    figures.replaceChildren(...rows.map(([name, v]) => {
      const row = make('div');
      row.append(make('dt', name), make('dd', v));
      return row;
    }));
  };
  // One question at a time; of those that came meanwhile the last one counts.
  let asking = false, next: Record<string, unknown> | null = null;
  async function ask(what: { pose?: number[]; joints?: number[] }): Promise<void> {
    next = { ...what, sets };
    if (asking) return;
    asking = true;
    while (next !== null) {
      const now: Record<string, unknown> = next;
      next = null;
      try {
        const answer = await post('pose', now);
        show(answer);
        if (!answer.error && !answer.reason) {
          if (now['joints']) answer.pose?.forEach((v, i) => { pose[i] = v; poseFields[i]?.set(v); });
          if (now['pose']) answer.joints?.forEach((v, i) => { joints[i] = v; jointFields[i]?.set(v); });
        }
      } catch (error) {
        show({ error: `The program does not answer any more: ${String(error)}` });
      }
    }
    asking = false;
  }
  // What this page asked for before is given up by the program when it asks anew.
  const client = Math.random().toString(36).slice(2);
  let timer = 0, running: AbortController | null = null, wanted = false;
  function later(): void {
    if (!wanted) return;
    window.clearTimeout(timer);
    timer = window.setTimeout(() => void workspace(), 250);
  }
  async function workspace(): Promise<void> {
    wanted = true;
    running?.abort();
    const mine = (running = new AbortController());
    const since = Date.now();
    const say = (): void => {
      volume.textContent = `The workspace is being computed … ${Math.round((Date.now() - since) / 1000)} s`;
      volume.className = '';
    };
    say();
    cancel.hidden = false;
    const ticking = window.setInterval(say, 1000);
    const end = (): void => {
      window.clearInterval(ticking);
      if (mine === running) cancel.hidden = true;
    };
    try {
      const answer = await post('workspace', { sets, pose, tilt_deg: tilt, client }, mine.signal).finally(end);
      if (mine !== running) return;
      volume.textContent = answer.error ?? answer.volume ?? '';
      volume.className = answer.error === undefined ? '' : 'note';
      if (answer.error === undefined && answer.scene) picture()?.setScene(answer.scene);
    } catch (error) {
      if (mine === running) volume.textContent = mine.signal.aborted ? 'Cancelled.' : String(error);
    }
  }
  void ask({ pose });
}

if (host && text) {
  const data = JSON.parse(text) as LiveData | FollowData;
  if ('record' in data) follow(host, data);
  else start(host, data);
}
