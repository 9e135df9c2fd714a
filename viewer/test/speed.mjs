// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// How fast pages are where a browser draws without a graphics card: until a page of a program of 100 000 lines is there,
// pictures a second while it is turned, and while a record that grows is followed.
// usage: node test/speed.mjs PROGRAM
import { spawn, spawnSync } from 'node:child_process';
import { copyFileSync, appendFileSync, mkdtempSync, readFileSync, rmSync, writeFileSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { dirname, join, resolve } from 'node:path';
import { fileURLToPath } from 'node:url';
import { chromium } from 'playwright-core';

const root = resolve(dirname(fileURLToPath(import.meta.url)), '../..');
const program = resolve(process.argv[2] ?? '');
const out = mkdtempSync(join(tmpdir(), 'polypod-speed-'));
const browser = await chromium.launch({
  executablePath: process.env.CHROMIUM ?? '/usr/bin/chromium',
  args: ['--no-sandbox', '--enable-unsafe-swiftshader', '--use-angle=swiftshader', '--ignore-gpu-blocklist'],
});
const wait = (ms) => new Promise((done) => setTimeout(done, ms));

/** A page whose pictures in space are counted. */
async function open(address) {
  const page = await browser.newPage({ viewport: { width: 1200, height: 900 } });
  await page.addInitScript(() => {
    window.pictures = 0;
    const clear = WebGL2RenderingContext.prototype.clear;
    WebGL2RenderingContext.prototype.clear = function (...mask) {
      ++window.pictures;
      return clear.apply(this, mask);
    };
  });
  const begin = Date.now();
  await page.goto(address);
  await page.waitForSelector('figure.scene.live', { timeout: 30000 });
  return { page, opened: Date.now() - begin };
}
/** Pictures a second while `act` goes on. */
async function rate(page, act) {
  const before = await page.evaluate(() => window.pictures), begin = Date.now();
  await act();
  return ((await page.evaluate(() => window.pictures)) - before) / ((Date.now() - begin) / 1000);
}

/** The square of SLAV 6 in 100 000 short lines. */
async function longProgram() {
  const square = join(root, 'examples/slavkovic_square'), corners = [[-135, 125], [125, 125], [125, -125], [-125, -125], [-125, 135]];
  const lines = ['G17 G21 G40 G49 G80 G90 G94', 'G54', 'T1 M6', 'S8000 M3', 'G0 X-135 Y125 Z10', 'G0 Z2', 'G1 Z-2 F400', 'F1600'];
  const kLines = 100000, each = kLines / 4;
  for (let side = 0; side < 4; ++side) {
    const [from, to] = [corners[side], corners[side + 1]];
    for (let i = 1; i <= each; ++i) lines.push(`G1 ${['X', 'Y'].map((axis, k) => axis + (from[k] + ((to[k] - from[k]) * i) / each).toFixed(4)).join(' ')}`);
  }
  writeFileSync(join(out, 'long.ngc'), [...lines, 'G0 Z10', 'M5', 'M30', ''].join('\n'));
  copyFileSync(join(square, 'job.toml'), join(out, 'job.toml'));
  for (const [name, words] of [['predict', []], ['correct', ['-o', 'corrected.ngc']]]) {
    const file = join(out, `${name}.html`);
    spawnSync(program, [name, 'long.ngc', '--job', 'job.toml', ...words, '--report', file], { cwd: out });
    const { page, opened } = await open(`file://${file}`);
    const canvas = page.locator('figure.scene canvas').first();
    await canvas.scrollIntoViewIfNeeded();
    await wait(1000);
    const box = await canvas.boundingBox(), x = box.x + box.width / 2, y = box.y + box.height / 2;
    await page.mouse.move(x, y);
    await page.mouse.down();
    const turned = await rate(page, async () => {
      const begin = Date.now();
      for (let k = 0; Date.now() - begin < 5000; ++k) await page.mouse.move(x + 150 * Math.sin(k / 20), y + 60 * Math.cos(k / 20));
    });
    console.log(`${name}, ${kLines} lines: the page is there after ${opened} ms and turns at ${turned.toFixed(1)} pictures a second`);
    await page.close();
  }
}

/** A record that grows by a row a millisecond. */
async function liveRecord() {
  const table = join(out, 'motion.csv'), record = join(out, 'record.csv');
  spawnSync(program, ['move', 'hexapod-strut', '--points=0,0,75;6,0,75;6,5,76;0,0,75', '--speed=20', '--csv', table]);
  const [head, ...rows] = readFileSync(table, 'utf8').trim().split('\n').map((line) => line.split(','));
  const columns = ['x_mm', 'y_mm', 'z_mm', 'a_deg', 'b_deg', 'c_deg', ...[1, 2, 3, 4, 5, 6].map((k) => `q${k}_mm`)].map((name) => head.indexOf(name));
  writeFileSync(record, 'time_s,line,x_mm,y_mm,z_mm,a_deg,b_deg,c_deg,q1,q2,q3,q4,q5,q6\n');
  const begin = Date.now();
  let written = 0;
  const growing = setInterval(() => {
    let text = '';
    for (const due = Date.now() - begin; written < due; ++written) {
      const k = written % (2 * rows.length), row = rows[k < rows.length ? k : 2 * rows.length - 1 - k];
      text += `${(written / 1000).toFixed(3)},1,${columns.map((c) => row[c]).join(',')}\n`;
    }
    appendFileSync(record, text);
  }, 20);
  const view = spawn(program, ['view', record, 'hexapod-strut']);
  const address = await new Promise((done) => view.stdout.on('data', (text) => done(/http:\/\/127\.0\.0\.1:\d+\//.exec(String(text))[0])));
  const { page } = await open(`${address}0/live`);
  await wait(3000);
  console.log(`a record that grows by 1000 rows a second is followed at ${(await rate(page, () => wait(10000))).toFixed(1)} pictures a second`);
  clearInterval(growing);
  view.kill('SIGINT');
}

await longProgram();
await liveRecord();
await browser.close();
rmSync(out, { recursive: true });
