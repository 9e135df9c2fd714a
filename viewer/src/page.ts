// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The script of every page: values under the pointer, folded parts open on paper, and the start of the scenes. Reading a
// page needs none of it.

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

function shown(value: number, span: number): string {
  return value.toFixed(Math.max(0, Math.min(6, 2 - Math.floor(Math.log10(span || 1)))));
}

// Curves: the value of each at the pointer.
for (const svg of document.querySelectorAll<SVGSVGElement>('svg[data-x]')) {
  const four = (text: string | undefined): number[] => (text ?? '').split(' ').map(Number);
  const X = four(svg.dataset['x']), Y = four(svg.dataset['y']);
  const curves = [...svg.querySelectorAll<SVGPathElement>('path[data-name]')].map((path) => ({
    name: path.dataset['name'] ?? '',
    runs: (path.getAttribute('d') ?? '').split('M').filter(Boolean).map((run) => run.split('L').map((point) => point.split(' ').map(parseFloat))),
  }));
  svg.addEventListener('pointermove', (e) => {
    const box = svg.getBoundingClientRect();
    const x = ((e.clientX - box.left) * svg.viewBox.baseVal.width) / box.width;
    if (x < X[2]! || x > X[3]!) {
      tip.hide();
      return;
    }
    const v = X[0]! + ((x - X[2]!) / (X[3]! - X[2]!)) * (X[1]! - X[0]!);
    const rows = [`${svg.dataset['label']}: ${shown(v, X[1]! - X[0]!)}`];
    for (const curve of curves) {
      curve.runs.some((run) => {
        for (let i = 1; i < run.length; ++i) {
          const a = run[i - 1]!, b = run[i]!;
          if (a[0]! > x || x > b[0]!) continue;
          const t = b[0]! > a[0]! ? (x - a[0]!) / (b[0]! - a[0]!) : 0, y = a[1]! + t * (b[1]! - a[1]!);
          const value = Y[0]! + ((y - Y[2]!) / (Y[3]! - Y[2]!)) * (Y[1]! - Y[0]!);
          rows.push(`${curve.name}: ${shown(value, Y[1]! - Y[0]!)} ${svg.dataset['unit']}`);
          return true;
        }
        return false;
      });
    }
    tip.show(rows, e.clientX, e.clientY);
  });
  svg.addEventListener('pointerleave', () => tip.hide());
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
