// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The script of every page: values under the pointer, folded parts open on paper, and the start of the scenes. Reading a
// page needs none of it.

import { readPlots, tableOf, type Stretch } from './plots';

const tipBox = document.createElement('div');
tipBox.id = 'tip';
document.body.appendChild(tipBox);

const tip = {
  show(rows: string[], x: number, y: number): void {
    tipBox.replaceChildren(...rows.map((text) => {
      const row = document.createElement('div');
      row.textContent = text;
      return row;
    }));
    tipBox.style.display = 'block';
    tipBox.style.left = `${Math.max(4, Math.min(x + 14, innerWidth - tipBox.offsetWidth - 8))}px`;
    tipBox.style.top = `${y + 14 + tipBox.offsetHeight > innerHeight ? y - 10 - tipBox.offsetHeight : y + 14}px`;
  },
  hide(): void {
    tipBox.style.display = 'none';
  },
};
(window as unknown as { polypodTip: typeof tip }).polypodTip = tip;

// A line of the program that is picked anywhere shows everywhere: in curves, in tables, in scenes.
let picked: number | null = null;
function pick(line: number | null): void {
  picked = line;
  document.dispatchEvent(new CustomEvent('polypod:line', { detail: line }));
}

document.addEventListener('polypod:pick', (e) => {
  const line = (e as CustomEvent<number>).detail;
  pick(line === picked ? null : line);
});

// Plots: what stands under the pointer, the line of the program that is picked, the cursor of what plays.
for (const plot of readPlots(tip)) {
  if (!plot.hasAxis) continue;
  const { svg, X, Y, title } = plot;
  // What plays in a scene has a cursor here, and goes where this curve is clicked.
  let cursor: SVGPathElement | null = null;
  document.addEventListener('polypod:frame', (e) => {
    const at = (e as CustomEvent<Map<string, number>>).detail.get(title);
    if (at === undefined || !(at >= X.low && at <= X.high)) {
      cursor?.remove();
      cursor = null;
      return;
    }
    if (cursor === null) {
      cursor = document.createElementNS(svg.namespaceURI, 'path') as SVGPathElement;
      cursor.setAttribute('class', 'cursor');
      svg.append(cursor);
    }
    cursor.setAttribute('d', `M${X(at).toFixed(1)} ${Y.from}V${Y.to}`);
  });
  svg.addEventListener('click', (e) => {
    const v = plot.valueAt(e);
    if (v !== null) setTimeout(() => document.dispatchEvent(new CustomEvent('polypod:at', { detail: { title, value: v } })));
  });
  if (!plot.parts.some((s) => Number.isFinite(s.line))) continue;
  svg.addEventListener('click', (e) => {
    const v = plot.valueAt(e);
    const part = v === null ? undefined : plot.partAt(v);
    pick(part && Number.isFinite(part.line) && part.line !== picked ? part.line : null);
  });
  const marks: Element[] = [];
  document.addEventListener('polypod:line', () => {
    for (const mark of marks.splice(0)) mark.remove();
    for (const s of plot.parts) if (s.line === picked) marks.push(plot.mark(s.from, s.to, 'picked'));
  });
}

// Tables: a click on a title sorts, rows can be filtered, a row with a line of the program picks it.
const numberIn = (text: string): number => Number(text.replace(/\u2212/g, '-').replace(/[\u2009\u00a0 ]/g, '').replace(/[^0-9.e+-].*$/, '') || NaN);
for (const table of document.querySelectorAll<HTMLTableElement>('main table')) {
  const body = table.tBodies[0], heads = table.tHead?.rows[0]?.cells;
  if (!body || !heads || body.rows.length < 2) continue;
  const given = [...body.rows];
  [...heads].forEach((head, column) => {
    if ((head.textContent ?? '') === '') return;
    const button = document.createElement('button');
    button.type = 'button';
    button.className = 'sort';
    button.append(...head.childNodes);
    head.append(button);
    button.addEventListener('click', () => {
      const before = head.getAttribute('aria-sort');
      for (const other of heads) other.removeAttribute('aria-sort');
      const next = before === null ? 'ascending' : before === 'ascending' ? 'descending' : null;
      if (next === null) {
        body.append(...given);
        return;
      }
      head.setAttribute('aria-sort', next);
      const sign = next === 'ascending' ? 1 : -1;
      const key = (row: HTMLTableRowElement): string => row.cells[column]?.textContent ?? '';
      body.append(...[...given].sort((a, b) => {
        const [u, v] = [numberIn(key(a)), numberIn(key(b))];
        if (Number.isNaN(u) || Number.isNaN(v)) return Number.isNaN(u) && Number.isNaN(v) ? sign * key(a).localeCompare(key(b)) : Number.isNaN(u) ? 1 : -1;
        return sign * (u - v);
      }));
    });
  });
  const tools = document.createElement('div');
  tools.className = 'tools';
  if (given.length > 15) {
    const filter = document.createElement('input');
    filter.type = 'search';
    filter.placeholder = 'only rows with …';
    filter.setAttribute('aria-label', 'Only rows that hold this text');
    filter.addEventListener('input', () => {
      for (const row of given) row.hidden = !(row.textContent ?? '').toLowerCase().includes(filter.value.toLowerCase());
    });
    tools.append(filter);
  }
  tools.append(saving('CSV', () => {
    const quoted = (text: string): string => (/[",\n]/.test(text) ? `"${text.replace(/"/g, '""')}"` : text);
    const line = (row: HTMLTableRowElement): string => [...row.cells].map((c) => {
      const small = c.querySelector('small')?.textContent ?? '';
      const text = c.textContent ?? '';
      return quoted(small === '' ? text.replace(/\u2212/g, '-').replace(/(\d)\u2009(?=\d)/g, '$1') : `${text.slice(0, text.length - small.length)} [${small}]`);
    }).join(',');
    save(new Blob([[table.tHead!.rows[0]!, ...body.rows].map(line).join('\n') + '\n'], { type: 'text/csv' }), 'table.csv');
  }, 'Save this table (CSV)'));
  table.parentElement?.after(tools);
  if (/^line/.test(heads[0]?.textContent ?? '')) {
    for (const row of given) {
      const line = numberIn(row.cells[0]?.textContent ?? '');
      if (!Number.isFinite(line)) continue;
      row.classList.add('picks');
      row.addEventListener('click', () => pick(line === picked ? null : line));
      document.addEventListener('polypod:line', () => row.classList.toggle('picked', line === picked));
      document.addEventListener('polypod:stretch', (e) => {
        const stretch = (e as CustomEvent<Stretch | null>).detail;
        row.classList.toggle('picked', stretch === null ? line === picked : stretch.lines.includes(line));
      });
    }
  }
}

// Figures as files.
function save(blob: Blob, name: string): void {
  const link = document.createElement('a');
  link.href = URL.createObjectURL(blob);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}
function saving(text: string, done: () => void, label: string): HTMLButtonElement {
  const button = document.createElement('button');
  button.type = 'button';
  button.textContent = text;
  button.title = label;
  button.setAttribute('aria-label', label);
  button.addEventListener('click', done);
  return button;
}
function svgText(svg: SVGSVGElement): string {
  const copy = svg.cloneNode(true) as SVGSVGElement;
  for (const mark of copy.querySelectorAll('.cursor, .stretch, .picked')) mark.remove();
  const style = document.createElementNS(svg.namespaceURI, 'style');
  const rules = [...document.styleSheets].flatMap((sheet) => [...sheet.cssRules]).filter((r): r is CSSStyleRule => r instanceof CSSStyleRule && r.selectorText.includes('svg.pp')).map((r) => r.cssText);
  const own = getComputedStyle(document.documentElement);
  const colours = ['ground', 'panel', 'rule', 'ink', 'muted', 'grid', 'blue', 'vermillion', 'green', 'purple', 'orange', 'sky'].map((c) => `--${c}:${own.getPropertyValue(`--${c}`).trim()}`);
  style.textContent = `svg.pp{${colours.join(';')};background:var(--ground);font-family:sans-serif}\n${rules.join('\n')}`;
  copy.prepend(style);
  return new XMLSerializer().serializeToString(copy);
}
for (const svg of document.querySelectorAll<SVGSVGElement>('main figure .wide > svg.pp, main figure .panels svg.pp')) {
  const tools = document.createElement('div');
  tools.className = 'tools';
  const name = (svg.getAttribute('aria-label') ?? 'figure').replace(/[^A-Za-z0-9]+/g, '-').replace(/^-|-$/g, '').slice(0, 60).toLowerCase();
  const what = svg.getAttribute('aria-label') ?? 'this figure';
  tools.append(saving('SVG', () => save(new Blob([svgText(svg)], { type: 'image/svg+xml' }), `${name}.svg`), `Save as SVG: ${what}`));
  tools.append(saving('PNG', () => {
    const image = new Image();
    image.onload = () => {
      const canvas = document.createElement('canvas');
      canvas.width = 2 * image.width;
      canvas.height = 2 * image.height;
      canvas.getContext('2d')!.drawImage(image, 0, 0, canvas.width, canvas.height);
      canvas.toBlob((blob) => blob && save(blob, `${name}.png`));
    };
    image.setAttribute('src', `data:image/svg+xml,${encodeURIComponent(svgText(svg))}`);
  }, `Save as PNG: ${what}`));
  if (tableOf(svg) !== null) {
    tools.append(saving('CSV', () => {
      const text = (cell: string | number): string => (typeof cell === 'number' ? String(cell) : `"${cell.replace(/"/g, '""')}"`);
      const rows = tableOf(svg)!.map((row, i) => row.map((cell) => (i === 0 && cell === 'curve' ? 'curve' : text(cell))).join(','));
      save(new Blob([rows.join('\n') + '\n'], { type: 'text/csv' }), `${name}.csv`);
    }, `Save the values (CSV): ${what}`));
  }
  svg.after(tools);
}

// What scrolls sideways can be reached by keys.
function reachable(): void {
  for (const part of document.querySelectorAll<HTMLElement>('.scroll, pre')) {
    if (part.scrollWidth > part.clientWidth) part.tabIndex = 0;
    else part.removeAttribute('tabindex');
  }
}
reachable();
addEventListener('resize', reachable);
document.addEventListener('toggle', reachable, true);

addEventListener('beforeprint', () => {
  for (const part of document.querySelectorAll('details')) part.open = true;
});

// Scenes: the viewer stands compressed in the page. What the policy of the page allows is this text and no other.
async function startScenes(): Promise<void> {
  const packed = document.getElementById('polypod-viewer')?.textContent;
  if (!packed || !document.querySelector('canvas[data-scene]')) return;
  const word = (text: string): void => {
    for (const figure of document.querySelectorAll('figure.scene')) {
      const p = document.createElement('p');
      p.className = 'still';
      p.textContent = text;
      figure.querySelector('figcaption')?.before(p);
    }
  };
  if (typeof DecompressionStream === 'undefined') {
    word('This picture stands still: the browser is too old for scenes that turn.');
    return;
  }
  const raw = Uint8Array.from(atob(packed.trim()), (c) => c.charCodeAt(0));
  const code = await new Response(new Blob([raw]).stream().pipeThrough(new DecompressionStream('deflate-raw'))).text();
  const script = document.createElement('script');
  script.textContent = code;
  document.body.appendChild(script);
}
startScenes().catch((error: unknown) => console.error(error));

export {};
