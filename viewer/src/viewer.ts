// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Makes every scene of the page turn. The page's own script (page.ts) starts this one.

import type { SceneData } from './data';
import { Picture } from './scene';

declare global {
  interface Window {
    polypodTip?: { show(rows: string[], x: number, y: number): void; hide(): void };
    polypodScenes?: Picture[];
  }
}

const tip = window.polypodTip ?? { show: () => {}, hide: () => {} };
window.polypodScenes = [];
for (const figure of document.querySelectorAll<HTMLElement>('figure.scene')) {
  const canvas = figure.querySelector<HTMLCanvasElement>('canvas[data-scene]');
  const text = figure.querySelector('script.scene-data')?.textContent;
  if (!canvas || !text) continue;
  try {
    window.polypodScenes.push(new Picture(figure, canvas, JSON.parse(text) as SceneData, tip));
  } catch (error) {
    figure.classList.remove('live');
    const word = document.createElement('p');
    word.className = 'still';
    word.textContent = `This picture stands still: the browser shows no WebGL (${error instanceof Error ? error.message : String(error)}).`;
    figure.querySelector('figcaption')?.before(word);
  }
}
