// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Opens pages of results in a browser and does with them what a reader does.
//
// Usage: node test/pages.mjs PROGRAM [--keep DIR] [--only NAME]
//
// Every page opens without a message on the console and without a request to anything but itself; it fits a screen of
// 390 px; axe-core finds no serious fault in light and dark. A page with a picture in space has a canvas that turns by mouse and keys and comes
// back with 0, and shows its drawn picture on paper, without scripts and without WebGL. Where it plays, the machine moves,
// the curves have a cursor that goes along, and the figures are those of the command's JSON.
import assert from 'node:assert/strict';
import { spawn, spawnSync } from 'node:child_process';
import { appendFileSync, existsSync, mkdirSync, mkdtempSync, readFileSync, rmSync, statSync, writeFileSync } from 'node:fs';
import { get } from 'node:http';
import { tmpdir } from 'node:os';
import { dirname, join, resolve } from 'node:path';
import { fileURLToPath } from 'node:url';
import { chromium } from 'playwright-core';

const here = dirname(fileURLToPath(import.meta.url));
const root = resolve(here, '../..');
const program = resolve(process.argv[2] ?? '');
const option = (name) => (process.argv.includes(name) ? process.argv[process.argv.indexOf(name) + 1] : undefined);
if (!existsSync(program)) {
  console.error('usage: node test/pages.mjs PROGRAM [--keep DIR] [--only NAME]');
  process.exit(2);
}
const keep = option('--keep');
const out = resolve(keep ?? mkdtempSync(join(tmpdir(), 'polypod-pages-')));
mkdirSync(out, { recursive: true });

// name: command line, and whether the page has a scene
const square = 'examples/slavkovic_square';
const pages = {
  workspace: [`workspace hexapod-strut --tilt 20 --rel-tol 0.2 --resolution 8 --report {page}`, true],
  delta: ['delta delta-brno --step 60 --report {page}', true],
  pick: ['pick delta-brno --from 150,0,600 --to -150,0,600 --report {page} --csv {page}.csv', true],
  dexterity: ['dexterity hexapod-strut --resolution 8 --report {page}', true],
  check: [`check ${square}/program.ngc --job ${square}/job.toml --report {page} --json`, true],
  misfit: [`check ${square}/program.ngc --machine lola50 --origin=0,-900,0 --report {page} --json`, true],
  move: [`move --program ${square}/program.ngc --job ${square}/job.toml --report {page} --json`, true],
  predict: [`predict ${square}/program.ngc --job ${square}/job.toml --report {page} --json`, true],
  correct: [`correct ${square}/program.ngc --job ${square}/job.toml -o {page}.ngc --report {page} --json`, true],
  watch: ['watch {record} --machine hexapod-strut --report {page} --json', true],
  machine: ['report hexapod-strut --resolution 8 --rel-tol 0.1 -o {page}', true],
  study: ['study {study} --report {page}', false],
  calibrate: ['calibrate hexapod-strut {measured} -o {page}.toml --residuals {page}.csv --report {page}', false],
  map: ['map lola50 --at 0 --x -600,600 --y -1600,-1000 --resolution 5 -o {page}', false],
};

/** A record as `polypod record` writes it, without LinuxCNC: a motion of the hexapod, whose second leg lags in the middle. */
const record = join(out, 'record.csv');
{
  const table = join(out, 'motion.csv');
  spawnSync(program, ['move', 'hexapod-strut', '--points=0,0,75;6,0,75;6,5,76', '--speed=20', '--csv', table], { cwd: root });
  const [head, ...rows] = readFileSync(table, 'utf8').trim().split('\n').map((line) => line.split(','));
  const names = ['t_s', 'line', 'x_mm', 'y_mm', 'z_mm', 'a_deg', 'b_deg', 'c_deg', ...[1, 2, 3, 4, 5, 6].map((k) => `q${k}_mm`)];
  const lines = rows.map((row, i) => names.map((n) => (n === 'q2_mm' ? String(Number(row[head.indexOf(n)]) + 0.03 * Math.sin((Math.PI * i) / rows.length) ** 8) : row[head.indexOf(n)])).join(','));
  writeFileSync(record, ['time_s,line,x_mm,y_mm,z_mm,a_deg,b_deg,c_deg,q1,q2,q3,q4,q5,q6', ...lines].join('\n') + '\n');
}

/** A study with a front, of figures at one pose: it takes a second. */
const study = join(out, 'study');
if (option('--only') === undefined || option('--only') === 'study') {
  const goal = (figure) => `[[goal]]\nfigure = "${figure}"\nsense = "min"\n`;
  writeFileSync(`${study}.toml`, `machine = "hexapod-strut"\nresolution = 8\nevaluations = 12\n[[vary]]\nkey = "base.radius_mm"\nvalues = [40, 50, 60]\n` +
    `[[vary]]\nkey = "platform.radius_mm"\nvalues = [10, 25]\n${goal('footprint_mm2')}${goal('tolerance_mm')}`);
  spawnSync(program, ['optimize', `${study}.toml`, '-o', study], { cwd: root });
}

/** Points that a tracker would have measured. */
const measured = join(out, 'measured.csv');
if (option('--only') === undefined || option('--only') === 'calibrate') {
  spawnSync(program, ['simulate', 'measurement', 'hexapod-strut', '--kind', 'points', '--count', '60', '--truth', `${measured}.toml`, '-o', measured], { cwd: root });
}

const problems = [];
let checks = 0;
function check(name, right, what) {
  ++checks;
  if (!right) problems.push(`${name}: ${what}`);
}

const browser = await chromium.launch({
  executablePath: process.env.CHROMIUM ?? '/usr/bin/chromium',
  args: ['--no-sandbox', '--enable-unsafe-swiftshader', '--use-angle=swiftshader', '--ignore-gpu-blocklist'],
});
const axe = readFileSync(join(here, '../node_modules/axe-core/axe.min.js'), 'utf8');

/** What a page says on the console and asks for, from now on. */
function heard(page) {
  const seen = { messages: [], requests: [] };
  page.on('console', (m) => ['error', 'warning'].includes(m.type()) && seen.messages.push(m.text()));
  page.on('pageerror', (e) => seen.messages.push(String(e)));
  page.on('request', (q) => seen.requests.push(q.url()));
  return seen;
}
/** A page in a window of its own; `seen` collects what it says and asks for. */
async function open(file, options = {}, before = undefined) {
  const context = await browser.newContext({ viewport: { width: 1200, height: 900 }, ...options });
  const page = await context.newPage();
  const seen = heard(page);
  if (before) await page.addInitScript(before);
  await page.goto(`file://${file}`);
  return { context, page, seen };
}
const pixels = (page) => page.locator('canvas[data-scene]').first().evaluate((c) => c.toDataURL());
// Two pictures later; a browser that draws none at the moment (a window behind, a busy machine) is not waited for for ever.
const settle = (page) => page.evaluate(() => new Promise((done) => {
  requestAnimationFrame(() => requestAnimationFrame(done));
  setTimeout(done, 5000);
}));
/** A step that does not end says which one it was, and the others go on; without it a promise that is never kept hangs the run. */
const kPatience = 180000; // ms
async function step(name, act) {
  let timer;
  const late = new Promise((_, fail) => { timer = setTimeout(() => fail(new Error(`not done after ${kPatience / 1000} s`)), kPatience); });
  try {
    await Promise.race([act(), late]);
  } catch (error) {
    check(name, false, String(error).split('\n')[0]);
  } finally {
    clearTimeout(timer);
  }
}
/** What stands beside the pointer, with hyphens that `Number` takes. */
const told = async (page) => (await page.locator('#tip').innerText()).replaceAll('\u2212', '-').split('\n');
async function turned(page, act) {
  const before = await pixels(page);
  await act();
  await settle(page);
  return (await pixels(page)) !== before;
}

async function judge(name, page) {
  await page.evaluate(axe);
  const found = await page.evaluate(() => globalThis.axe.run(document, { runOnly: ['wcag2a', 'wcag2aa'] }));
  const serious = found.violations.filter((v) => ['serious', 'critical'].includes(v.impact));
  check(name, serious.length === 0, serious.map((v) => `${v.id}: ${v.help}: ${v.nodes[0].target}: ${v.nodes[0].failureSummary}`).join('; '));
}

async function look(name, file, hasScene) {
  const wide = await open(file);
  const { page, seen } = wide;
  if (hasScene) {
    const live = await page.waitForSelector('figure.scene.live', { timeout: 20000 }).catch(() => null);
    check(name, live !== null, 'its scene does not come alive');
    if (live) {
      const canvas = page.locator('canvas[data-scene]').first();
      await canvas.scrollIntoViewIfNeeded();
      await settle(page);
      const home = await pixels(page);
      const box = await canvas.boundingBox();
      check(name, await turned(page, async () => {
        await page.mouse.move(box.x + 300, box.y + 200);
        await page.mouse.down();
        await page.mouse.move(box.x + 420, box.y + 240, { steps: 4 });
        await page.mouse.up();
      }), 'a drag does not turn it');
      check(name, await turned(page, () => page.keyboard.press('ArrowLeft')), 'an arrow does not turn it');
      check(name, await turned(page, () => page.keyboard.press('+')), 'plus does not zoom');
      check(name, await turned(page, () => page.mouse.wheel(0, 200)), 'the wheel does not zoom');
      check(name, await turned(page, () => page.keyboard.press('Shift+ArrowUp')), 'shift and an arrow do not move it');
      await page.keyboard.press('0');
      await settle(page);
      check(name, (await pixels(page)) === home, '0 does not bring it back');
      check(name, (await page.locator('.labels span:visible').count()) > 6, 'its axes have no numbers');
    }
  } else {
    check(name, (await page.locator('canvas').count()) === 0, 'it has a canvas that nobody expects');
  }
  if (hasScene) {
    // The picture that turns has a layer of its own, and figures far out of sight are not painted with it.
    check(name, (await page.locator('figure.scene.live .stage').first().evaluate((e) => `${getComputedStyle(e).contain} ${getComputedStyle(e).willChange}`)) === 'strict transform', 'a frame of its scene paints the page');
    check(name, await page.evaluate(() => [...document.querySelectorAll('figure:not(.scene)')].every((f) => getComputedStyle(f).contentVisibility === 'auto')), 'figures out of sight are painted');
  }
  await judge(`${name}, axe`, page);
  await page.emulateMedia({ colorScheme: 'dark' });
  await settle(page);
  await judge(`${name}, axe, dark`, page);
  await page.emulateMedia({ media: 'print', colorScheme: 'light' });
  check(name, await page.locator('svg.pp').first().isVisible(), 'on paper it has no picture');
  check(name, await page.evaluate(() => [...document.querySelectorAll('figure')].every((f) => getComputedStyle(f).contentVisibility === 'visible')), 'on paper a figure may be missing');
  if (hasScene) {
    check(name, !(await page.locator('canvas[data-scene]').first().isVisible()), 'on paper the canvas shows');
    check(name, await page.locator('figure.scene .wide svg').first().isVisible(), 'on paper the drawn scene is missing');
  }
  check(name, seen.messages.length === 0, `the console says: ${seen.messages.join(' | ')}`);
  check(name, seen.requests.every((url) => url === `file://${file}`), `it asks for ${seen.requests.join(' ')}`);
  await wide.context.close();

  const narrow = await open(file, { viewport: { width: 390, height: 800 }, hasTouch: true, isMobile: true });
  if (hasScene) {
    const live = await narrow.page.waitForSelector('figure.scene.live', { timeout: 20000 }).catch(() => null);
    check(name, live !== null, 'at 390 px its scene does not come alive');
  }
  const width = await narrow.page.evaluate(() => document.documentElement.scrollWidth);
  check(name, width <= 390, `at 390 px it is ${width} px wide`);
  check(name, narrow.seen.messages.length === 0, `at 390 px the console says: ${narrow.seen.messages.join(' | ')}`);
  await narrow.context.close();
}

/** The pose and the joints that the page reads out at every end of its sliders are those of `polypod ik`. */
async function posesAreThoseOfTheProgram(name, machine, file) {
  const { context, page } = await open(file);
  await page.waitForSelector('figure.scene.live', { timeout: 20000 });
  const rows = await page.evaluate(() => {
    const scene = JSON.parse(document.querySelector('script.scene-data').textContent);
    return scene.frames.filter((f) => !f.name.startsWith('q')).flatMap((f) => [0, 7, f.at.length - 1].map((i) => f.columns.map((c) => [c.name, c.values[i]])));
  });
  for (const row of rows) {
    const pose = row.filter(([n]) => !n.startsWith('q')).map(([, v]) => v), joints = row.filter(([n]) => n.startsWith('q')).map(([, v]) => v);
    const done = spawnSync(program, ['ik', machine, `--pose=${pose.join(',')}`, '--json'], { cwd: root, encoding: 'utf8' });
    const solutions = JSON.parse(done.stdout).solutions;
    const off = Math.min(...solutions.map((s) => Math.max(...s.joints.map((q, i) => Math.abs(q - joints[i])))));
    // Ten digits stand in the page.
    check(name, off < 1e-6, `at ${pose} it shows ${joints}, ik says ${JSON.stringify(solutions.map((s) => s.joints))}`);
  }
  check(name, rows.length > 6, 'it has no sliders');
  // What is shown is what stands in the data.
  const slider = page.locator('.slide', { has: page.locator('span', { hasText: /^z$/ }) }).locator('input');
  await slider.focus();
  check(name, await turned(page, () => page.keyboard.press('End')), 'a slider does not move the machine');
  const told = await page.locator('.reading dd').nth(2).textContent();
  const z = rows.map((r) => r[2][1]).reduce((a, b) => Math.max(a, b));
  check(name, Math.abs(parseFloat(told) - z) < 1e-3, `it reads out z ${told} where ${z} stands`);
  await context.close();
}

/**
 * The scene stands where its data say. The machine at its start is in them twice, as floats and in steps of the box; of
 * the surfaces the ends along each axis are read here in another way than the page's own.
 */
async function sceneStandsWhereItIs(name, file) {
  const { context, page } = await open(file);
  await page.waitForSelector('figure.scene.live', { timeout: 20000 });
  const found = await page.evaluate(() => {
    const scene = JSON.parse(document.querySelector('script.scene-data').textContent), shown = globalThis.polypodScenes[0];
    const view = (text) => new DataView(Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer);
    const machine = scene.lines.map((line, k) => ({ line, points: [...shown.lines[k].points] })).filter(({ line }) => line.moves).map(({ line, points }) => {
      const given = view(line.points);
      return { name: line.name, off: Math.max(...points.map((x, i) => Math.abs(x - given.getFloat32(4 * i, true))).filter(Number.isFinite)), count: points.length };
    });
    const steps = [0, 1, 2].map((k) => (scene.high[k] - scene.low[k]) / 65534);
    const ends = (numbers) => [0, 1, 2].map((k) => {
      const along = numbers.filter((_, i) => i % 3 === k);
      return [along.reduce((a, b) => Math.min(a, b), Infinity), along.reduce((a, b) => Math.max(a, b), -Infinity)];
    });
    const meshes = scene.meshes.map((mesh, m) => {
      const data = view(mesh.points.data), triangles = view(mesh.triangles), numbers = [];
      for (let i = 0; i < triangles.byteLength / 4; ++i)
        for (let k = 0; k < 3; ++k) numbers.push(scene.low[k] + steps[k] * data.getUint16(2 * (3 * triangles.getUint32(4 * i, true) + k), true));
      return [ends(numbers), ends([...shown.surfaces[m].mesh.geometry.getAttribute('position').array])];
    });
    return { machine, meshes, step: Math.max(...steps) };
  });
  for (const { name: part, off, count } of found.machine) check(name, off <= found.step && count > 0, `${part} of the machine stands ${off} beside where it is; a step is ${found.step}`);
  for (const [own, drawn] of found.meshes) check(name, own.flat().every((x, i) => Math.abs(x - drawn.flat()[i]) <= found.step), `a surface goes from ${drawn}, its data say ${own}`);
  check(name, found.machine.length > 0 && found.meshes.length > 0, `there are ${found.machine.length} parts of the machine and ${found.meshes.length} surfaces`);
  await context.close();
}

/** The pointer on a curve reads the figures of the command's own table; the figure and a table are saved with them. */
async function curvesHoldTheFigures(name, file) {
  const [head, ...rows] = readFileSync(`${file}.csv`, 'utf8').trim().split('\n').map((line) => line.split(','));
  const column = (title) => rows.map((row) => Number(row[head.indexOf(title)]));
  const time = column('t_s'), speed = column('q1_deg_per_s');
  const { context, page, seen } = await open(file, { acceptDownloads: true });
  await page.waitForSelector('figure.scene.live', { timeout: 20000 }); // it moves what is below it
  const svg = page.locator('.wide svg[aria-label^="speed of the drives"]');
  await svg.scrollIntoViewIfNeeded();
  await settle(page);
  const box = await svg.boundingBox();
  const [low, high, left, right] = (await svg.getAttribute('data-x')).split(' ').map(Number);
  const width = await svg.evaluate((e) => e.viewBox.baseVal.width);
  let compared = 0;
  for (const k of [40, 111, 250, 333]) {
    const x = left + ((time[k] - low) / (high - low)) * (right - left);
    await page.mouse.move(box.x + (x * box.width) / width, box.y + box.height / 2);
    const rows = await told(page);
    const value = Number(/drive 1: ([-+.0-9e]+)/.exec(rows.join('\n'))?.[1]);
    // The pointer stands between two samples: one of them is read.
    const near = [k - 1, k, k + 1].map((i) => Math.abs(value - speed[i]) / Math.max(1, Math.abs(speed[i])));
    check(name, Math.min(...near) < 1e-5, `at ${time[k]} s the pointer reads ${rows.join(', ')}; the table says ${speed[k]}`);
    ++compared;
  }
  check(name, compared === 4, 'no curve is read');
  const figure = page.locator('figure', { has: svg });
  for (const kind of ['SVG', 'PNG', 'CSV']) {
    const waiting = page.waitForEvent('download');
    await figure.locator('.tools button', { hasText: kind }).first().click();
    const path = await (await waiting).path();
    const bytes = readFileSync(path);
    const right = kind === 'PNG' ? bytes.subarray(1, 4).toString() === 'PNG' : kind === 'SVG' ? /^<svg[^>]*xmlns=/.test(bytes.toString()) : bytes.toString().includes(`,${Number(speed[111].toPrecision(9))}`);
    check(name, right && bytes.length > 500, `${kind} is no such file: ${bytes.subarray(0, 60)}`);
  }
  const table = page.locator('main table').last();
  await table.locator('th .sort').nth(0).click();
  check(name, (await table.locator('th[aria-sort=ascending]').count()) === 1, 'a table does not sort');
  check(name, seen.messages.length === 0, `the console says: ${seen.messages.join(' | ')}`);
  await context.close();
}

/** Dragging over a curve selects a stretch: least and greatest of its figures there. */
async function stretches(name, file) {
  const [head, ...rows] = readFileSync(`${file}.csv`, 'utf8').trim().split('\n').map((line) => line.split(','));
  const column = (title) => rows.map((row) => Number(row[head.indexOf(title)]));
  const time = column('t_s'), speed = column('q1_deg_per_s');
  const { context, page, seen } = await open(file);
  await page.waitForSelector('figure.scene.live', { timeout: 20000 }); // it moves what is below it
  const svg = page.locator('.wide svg[aria-label^="speed of the drives"]');
  await svg.scrollIntoViewIfNeeded();
  await settle(page);
  const box = await svg.boundingBox();
  const [low, high, left, right] = (await svg.getAttribute('data-x')).split(' ').map(Number);
  const width = await svg.evaluate((e) => e.viewBox.baseVal.width);
  const place = (k) => box.x + ((left + ((time[k] - low) / (high - low)) * (right - left)) * box.width) / width;
  const [a, b] = [40, 333];
  await page.mouse.move(place(a), box.y + box.height / 2);
  await page.mouse.down();
  await page.mouse.move(place(200), box.y + box.height / 2);
  await page.mouse.move(place(b), box.y + box.height / 2);
  await page.mouse.up();
  const words = (await page.locator('figure', { has: svg }).locator('p.stretch').innerText()).replaceAll('\u2212', '-');
  const [least, greatest] = (/drive 1: ([-+.0-9e]+) to ([-+.0-9e]+)/.exec(words) ?? []).slice(1).map(Number);
  const inside = speed.slice(a + 2, b - 1), wide = speed.slice(a - 2, b + 3);
  const last = 1e-4 * Math.max(...speed.map(Math.abs)); // five digits are told
  check(name, least <= Math.min(...inside) + last && least >= Math.min(...wide) - last, `least ${least}, the table says ${Math.min(...inside)}: ${words}`);
  check(name, greatest >= Math.max(...inside) - last && greatest <= Math.max(...wide) + last, `greatest ${greatest}, the table says ${Math.max(...inside)}: ${words}`);
  check(name, (await page.locator('.wide rect.stretch').count()) > 2, 'the stretch does not show in the other curves');
  await page.keyboard.press('Escape');
  check(name, (await page.locator('.stretch').count()) === 0, 'Escape leaves the stretch');
  check(name, seen.messages.length === 0, `the console says: ${seen.messages.join(' | ')}`);
  await context.close();
}

/** The pointer on a map reads the value of the nearest point of its grid, at both widths, and the map is saved as a table. */
async function mapsHoldTheirValues(name, file) {
  for (const width of [1200, 390]) {
    const { context, page, seen } = await open(file, { viewport: { width, height: 900 } });
    const svg = page.locator('svg[data-plot=map]:visible').first();
    await svg.scrollIntoViewIfNeeded();
    // Points of the grid with a value, and where they are, by a reading of the attributes that is not the page's own.
    const grid = await svg.evaluate((e) => {
      const from = e.closest('.narrow') ? e.closest('figure').querySelector('.wide svg') : e;
      const [columns, rows, x0, x1, y0, y1] = from.dataset.grid.split(' ').map(Number);
      const values = new Float32Array(Uint8Array.from(atob(from.dataset.f), (c) => c.charCodeAt(0)).buffer);
      const X = e.dataset.x.split(' ').map(Number), Y = e.dataset.y.split(' ').map(Number);
      const box = e.getBoundingClientRect(), scale = box.width / e.viewBox.baseVal.width;
      const points = [...values].map((value, n) => {
        const x = x0 + ((n % columns) / (columns - 1)) * (x1 - x0), y = y0 + (Math.floor(n / columns) / (rows - 1)) * (y1 - y0);
        const px = X[2] + ((x - X[0]) / (X[1] - X[0])) * (X[3] - X[2]), py = Y[2] + ((y - Y[0]) / (Y[1] - Y[0])) * (Y[3] - Y[2]);
        return { x: box.left + px * scale, y: box.top + py * scale, value };
      });
      return { columns, rows, points, count: values.filter(Number.isFinite).length };
    });
    // Not at a border, so that there is a cell on each side.
    const inner = (n) => n % grid.columns > 0 && n % grid.columns < grid.columns - 1 && n >= grid.columns && n < grid.columns * (grid.rows - 1);
    const n = grid.points.findIndex((p, k) => Number.isFinite(p.value) && k > grid.points.length / 2 && inner(k));
    const at = grid.points[n], across = grid.points[n + 1].x - at.x, up = grid.points[n + grid.columns].y - at.y;
    // On the point itself, and 0.3 of a cell to each side of it, where another rounding reads a neighbour.
    for (const [i, j] of [[0, 0], [0.3, 0.3], [-0.3, 0.3], [0.3, -0.3], [-0.3, -0.3]]) {
      await page.mouse.move(at.x + i * across, at.y + j * up);
      const rows = await told(page);
      const read = rows.slice(2).map((row) => Number(/: ([-+.0-9e]+)/.exec(row)?.[1])); // below the place
      check(name, read.some((v) => Math.abs(v - at.value) <= 1e-4 * Math.abs(at.value)), `at ${width} px, ${i}, ${j} of a cell beside it, the pointer reads ${rows.join(', ')} where ${at.value} is`);
    }
    if (width === 1200) {
      const waiting = page.waitForEvent('download');
      await svg.locator('xpath=following-sibling::*[1]').locator('button', { hasText: 'CSV' }).click();
      const rows = readFileSync(await (await waiting).path(), 'utf8').trim().split('\n');
      check(name, rows.length === grid.count + 1, `its table has ${rows.length - 1} rows for ${grid.count} values`);
    }
    check(name, seen.messages.length === 0, `the console says: ${seen.messages.join(' | ')}`);
    await context.close();
  }
}

/** Where a value of a plot is on the screen, by a reading of its scales that is not the page's own. */
const placeIn = (svg, x, y) => svg.evaluate((e, [vx, vy]) => {
  const px = (scale, v) => { const [a, b, p, q] = scale.split(' ').map(Number); return p + ((v - a) / (b - a)) * (q - p); };
  const box = e.getBoundingClientRect(), scale = box.width / e.viewBox.baseVal.width;
  return { x: box.left + px(e.dataset.x, vx) * scale, y: box.top + px(e.dataset.y, vy) * scale };
}, [x, y]);
const near6 = (a, b) => Math.abs(a - b) <= 6e-6 * Math.abs(b); // six digits are told

/** Dots over the figures of the command's own table: those of a row are read together, saved and selected. */
async function dotsHoldTheFigures(name, file) {
  const [head, ...rows] = readFileSync(`${file}.csv`, 'utf8').trim().split('\n').map((line) => line.split(','));
  const of = (k, title) => Number(rows[k][head.indexOf(title)]), close = (a, b) => Math.abs(a - b) <= 5.1e-4 * Math.abs(b); // the table has four digits
  const after = (k) => (of(k, 'validation') === 1 ? 'after, validation set' : 'after');
  const { context, page, seen } = await open(file, { acceptDownloads: true });
  const svg = page.locator('.wide svg', { has: page.locator('path[data-dots="before"]') }).first(), figure = page.locator('figure', { has: svg });
  await svg.scrollIntoViewIfNeeded();
  for (const k of [0, 4, 17, rows.length - 1]) {
    // On each of the two dots of a row, and beside one: both are told.
    for (const [side, title] of [[0, 'before_um'], [0, 'after_um'], [0.3, 'after_um']]) {
      const at = await placeIn(svg, k + 1 + side, of(k, title));
      await page.mouse.move(at.x, at.y);
      const lines = await told(page);
      const value = (series) => Number(lines.find((line) => line.startsWith(`${series}: `))?.match(/: ([-+.0-9e]+) \S+$/)?.[1]);
      check(name, close(value('before'), of(k, 'before_um')) && close(value(after(k)), of(k, 'after_um')) && Number(lines[0].split(': ')[1]) === k + 1,
        `at row ${k + 1} the pointer reads ${lines.join(', ')}; the table says ${of(k, 'before_um')} and ${of(k, 'after_um')}`);
    }
  }
  const [download] = await Promise.all([page.waitForEvent('download'), figure.locator('.tools button', { hasText: 'CSV' }).first().click()]);
  const saved = readFileSync(await download.path(), 'utf8').trim().split('\n');
  check(name, saved.length === 2 * rows.length + 1, `its table has ${saved.length - 1} rows for ${2 * rows.length} dots`);
  check(name, saved.some((line) => line.startsWith('"after",18,') && close(Number(line.split(',')[2]), of(17, 'after_um'))), 'row 18 is not in its table');
  const [a, b] = [await placeIn(svg, 10.5, 0), await placeIn(svg, 20.5, 0)], height = (await svg.boundingBox()).y + 80;
  await page.mouse.move(a.x, height);
  await page.mouse.down();
  await page.mouse.move((a.x + b.x) / 2, height);
  await page.mouse.move(b.x, height);
  await page.mouse.up();
  const words = await figure.locator('p.stretch').innerText();
  const ends = (/before: ([-+.0-9e]+) to ([-+.0-9e]+)/.exec(words) ?? []).slice(1).map(Number);
  const inside = Array.from({ length: 10 }, (_, i) => of(10 + i, 'before_um'));
  check(name, close(ends[0], Math.min(...inside)) && close(ends[1], Math.max(...inside)), `of rows 11 to 20 it says ${words}`);
  check(name, seen.messages.length === 0, `the console says: ${seen.messages.join(' | ')}`);
  await context.close();
}

/** Dots that are scattered: the pointer reads the one that it is on, to the digits of the command's JSON. */
async function scatteredDotsAreRead(name, file) {
  const { front, start, listed } = JSON.parse(spawnSync(program, ['study', study, '--json'], { cwd: root, encoding: 'utf8' }).stdout);
  for (const width of [1200, 390]) {
    const { context, page, seen } = await open(file, { viewport: { width, height: 900 } });
    const svg = page.locator('svg:visible', { has: page.locator('path[data-dots="front"]') }).first();
    await svg.scrollIntoViewIfNeeded();
    for (const [series, row] of [...front.map((f) => ['front', f]), ['start', start], ['tried', start]]) {
      const { footprint_mm2: x, tolerance_mm: y } = row.values, at = await placeIn(svg, x, y);
      await page.mouse.move(at.x, at.y);
      const lines = await told(page);
      check(name, near6(Number(new RegExp(`^${series}: ([-+.0-9e]+)$`, 'm').exec(lines.join('\n'))?.[1]), y), `at ${width} px the pointer reads ${lines.join(', ')} where ${series} is ${x}, ${y}`);
    }
    check(name, front.length > 1 && listed.length > front.length, 'the study has no front');
    check(name, seen.messages.length === 0, `the console says: ${seen.messages.join(' | ')}`);
    await context.close();
  }
}

/** The pointer over parallel coordinates tells every value of the line below it. */
async function linesTellTheirValues(name, file) {
  for (const width of [1200, 390]) {
    const { context, page, seen } = await open(file, { viewport: { width, height: 900 } });
    const svg = page.locator('svg[data-plot=parallel]:visible').first();
    await svg.scrollIntoViewIfNeeded();
    // A line by a reading of the attributes that is not the page's own, between its first two axes: at an axis lines may meet.
    const at = await svg.evaluate((e) => {
      const from = e.closest('.narrow') ? e.closest('figure').querySelector('.wide svg') : e;
      const path = [...from.querySelectorAll('path[data-group]')].at(-1), names = e.dataset.names.split('|');
      const values = new Float32Array(Uint8Array.from(atob(path.dataset.f), (c) => c.charCodeAt(0)).buffer).slice(0, names.length);
      const crossed = e.dataset.axes.split(';').slice(0, 2).map((axis, k) => {
        const [place, a, b, p, q] = axis.split(' ').map(Number);
        return [place, p + ((values[k] - a) / (b - a)) * (q - p)];
      });
      const t = 0.3, [along, off] = [0, 1].map((c) => crossed[0][c] + t * (crossed[1][c] - crossed[0][c]));
      const box = e.getBoundingClientRect(), scale = box.width / e.viewBox.baseVal.width;
      const [x, y] = e.dataset.across === undefined ? [along, off] : [off, along];
      return { x: box.left + x * scale, y: box.top + y * scale, names, values: [...values] };
    });
    await page.mouse.move(at.x, at.y);
    const lines = (await told(page)).slice(1);
    check(name, lines.length === at.names.length && lines.every((row, k) => row.startsWith(`${at.names[k]}: `) && Math.abs(Number(row.split(': ').at(-1)) - at.values[k]) <= 1e-4 * Math.abs(at.values[k])),
      `at ${width} px the pointer reads ${lines.join(', ')} where ${at.values} are`);
    check(name, seen.messages.length === 0, `the console says: ${seen.messages.join(' | ')}`);
    await context.close();
  }
}

/** A line of the program that is picked in the table shows in the curves and in the scene, and the other way round. */
async function linesArePicked(name, file) {
  const { context, page } = await open(file);
  await page.waitForSelector('figure.scene.live', { timeout: 20000 });
  await page.locator('figure.scene').first().scrollIntoViewIfNeeded();
  await settle(page);
  const row = page.locator('tr.picks').nth(1);
  check(name, await turned(page, () => row.evaluate((e) => e.click())), 'a line that is picked in the table does not show in the scene');
  check(name, (await page.locator('svg.pp .picked').count()) > 1, 'it does not show in the curves');
  const line = Number(await row.locator('td').first().textContent());
  await page.evaluate((l) => document.dispatchEvent(new CustomEvent('polypod:pick', { detail: l })), line);
  check(name, (await page.locator('tr.picked').count()) === 0, 'picked again it stays');
  await page.locator('.wide svg[data-spans]').first().click();
  check(name, (await page.locator('tr.picked').count()) > 0, 'a click into a curve picks no line of the table');
  await context.close();
}

/** The machine moves when it is played, with the line, the time and a cursor in the curves; a click into one moves it there. */
async function plays(name, file, title, hasLines) {
  const { context, page, seen } = await open(file);
  await page.waitForSelector('figure.scene.live', { timeout: 20000 });
  const figure = page.locator('figure.scene', { has: page.locator('.player') }).first();
  await figure.locator('canvas').scrollIntoViewIfNeeded();
  await settle(page);
  const shot = () => figure.locator('canvas').evaluate((c) => c.toDataURL());
  const moved = async (act) => {
    const before = await shot();
    await act();
    await settle(page);
    return (await shot()) !== before;
  };
  const slider = figure.locator('.slide', { has: page.locator('span', { hasText: /^time$/ }) }).locator('input');
  const at = async () => Number(await slider.inputValue());
  const svg = page.locator(`.wide svg[data-label="${title}"]`).first();
  const cursor = () => svg.locator('.cursor').evaluateAll((all) => all.map((c) => parseFloat(c.getAttribute('d').slice(1))));
  const frames = await figure.evaluate((f) => {
    const { frames } = JSON.parse(f.querySelector('script.scene-data').textContent);
    return frames[0];
  });
  await slider.focus();
  check(name, await moved(async () => { for (let k = 0; k < 4; ++k) await page.keyboard.press('ArrowRight'); }), 'keys on the slider do not move the machine');
  check(name, (await at()) === 4, `four keys lead to picture ${await at()}`);
  check(name, await moved(() => figure.getByLabel('A step on').evaluate((b) => { for (let k = 0; k < 30; ++k) b.click(); })), 'steps do not move the machine');
  check(name, (await at()) === 34, `then thirty steps lead to picture ${await at()}`);
  await figure.getByLabel('To the start').click();
  // So slow that it does not come to its end before it is paused.
  const kLong = 20; // s
  const speeds = await figure.getByLabel('Speed').locator('option').evaluateAll((all) => all.map((o) => o.value));
  await figure.getByLabel('Speed').selectOption(speeds.filter((v) => Number(v) <= frames.at.at(-1) / kLong).at(-1) ?? speeds[0]);
  check(name, await moved(async () => {
    await figure.getByLabel('Play').click();
    await page.waitForFunction((s) => Number(s.value) > 5, await slider.elementHandle(), { timeout: 20000 });
  }), 'playing does not move the machine');
  if ((await figure.getByLabel('Pause').count()) > 0) await figure.getByLabel('Pause').click();
  const stopped = await at();
  await page.waitForTimeout(300);
  check(name, (await at()) === stopped && stopped > 5, `paused it goes on from ${stopped} to ${await at()}`);
  if (hasLines) {
    const told = await figure.locator('.now').textContent();
    const line = frames.columns.find((c) => c.name === 'line').values[stopped];
    check(name, told.startsWith(`line ${line}: `) && told.length > 9, `it tells ${told}, the data say line ${line}`);
  }
  // The cursor stands where the figures are that are read out, and a click into the curve leads there.
  const [low, high, left, right] = (await svg.getAttribute('data-x')).split(' ').map(Number);
  const valuesOf = title.startsWith('time') ? frames.at : frames.columns.find((c) => title === `${c.name}, ${c.unit}`).values;
  const wanted = Math.floor(frames.at.length / 2) + valuesOf.slice(Math.floor(frames.at.length / 2)).findIndex((v) => v !== null);
  const xOf = (v) => left + ((v - low) / (high - low)) * (right - left);
  await svg.scrollIntoViewIfNeeded();
  await settle(page); // figures that come into sight move it
  const box = await svg.boundingBox();
  const width = await svg.evaluate((e) => e.viewBox.baseVal.width);
  await page.mouse.click(box.x + (xOf(valuesOf[wanted]) * box.width) / width, box.y + box.height / 2);
  await page.waitForTimeout(100);
  const shown = valuesOf[await at()];
  const perPixel = ((high - low) / (right - left)) * (width / box.width);
  check(name, Math.abs(shown - valuesOf[wanted]) < 2 * perPixel + (high - low) / 100, `a click at ${valuesOf[wanted]} leads to ${shown}`);
  const now = await cursor();
  check(name, now.length === 1 && Math.abs(now[0] - xOf(shown)) < 0.2, `the cursor stands at ${now}, not at ${xOf(shown)}`);
  await figure.locator('canvas').scrollIntoViewIfNeeded();
  check(name, await moved(() => figure.getByLabel('follow the tool').check()), 'it does not follow the tool');
  check(name, await moved(() => figure.getByLabel('follow the tool').uncheck()), 'it does not come back');
  await page.emulateMedia({ media: 'print' });
  check(name, !(await svg.locator('.cursor').first().isVisible()), 'on paper the cursor shows');
  check(name, seen.messages.length === 0, `the console says: ${seen.messages.join(' | ')}`);
  check(name, seen.requests.every((url) => url === `file://${file}`), `it asks for ${seen.requests.join(' ')}`);
  await context.close();
  return frames;
}
const largest = (frames, name) => Math.max(...frames.columns.find((c) => c.name === name).values.map((v) => v ?? -Infinity));
const near = (a, b) => Math.abs(a - b) <= 1e-6 * Math.max(1, Math.abs(b));

/** The curves of the joints go as far as the JSON says. */
async function jointsAreThoseOfTheJson(name, file, json) {
  const { context, page } = await open(file);
  for (const range of json.joint_ranges) {
    const label = range.unit === 'deg' ? 'angle' : 'length';
    const values = await page.locator(`.wide svg[aria-label] path[data-name="q${range.joint}"]`).evaluateAll((all) => all.map((p) => p.dataset.v ?? ''));
    const own = values.map((v) => v.split(';').map((p) => Number(p.split(',')[1])).filter(Number.isFinite));
    const right = own.some((v) => near(Math.min(...v), range.min) && near(Math.max(...v), range.max));
    check(name, right, `no curve of ${label} q${range.joint} goes from ${range.min} to ${range.max}: ${own.map((v) => `${Math.min(...v)} .. ${Math.max(...v)}`)}`);
  }
  check(name, json.joint_ranges.length > 2, 'the JSON has no joints');
  await context.close();
}

/** `polypod view` with its address. */
const start = (...words) => new Promise((done) => {
  const child = spawn(program, ['view', ...words], { cwd: root, stdio: ['ignore', 'pipe', 'pipe'] });
  const ended = new Promise((end) => child.on('exit', (code, signal) => end({ code, signal })));
  child.stdout.once('data', (text) => done({ child, ended, address: String(text).trim() }));
  child.on('exit', () => done({ child, ended, address: '' }));
});

/** A page of the server: it comes alive, says nothing on the console, asks nobody else, has no serious fault, fits 390 px. */
async function served(name, address, act) {
  for (const width of [1200, 390]) {
    const context = await browser.newContext({ viewport: { width, height: 900 } });
    const page = await context.newPage();
    const { messages, requests } = heard(page);
    await page.goto(address);
    check(name, (await page.waitForSelector('figure.scene.live', { timeout: 20000 }).catch(() => null)) !== null, 'its scene does not come alive');
    if (width === 1200) await act(page);
    await judge(`${name}, axe`, page);
    const wide = await page.evaluate(() => document.documentElement.scrollWidth);
    check(name, wide <= width, `at ${width} px it is ${wide} px wide`);
    check(name, messages.length === 0, `the console says: ${messages.join(' | ')}`);
    const origin = new URL(address).origin;
    check(name, requests.every((url) => url.startsWith(origin)), `it asks for ${requests.join(' ').slice(0, 300)}`);
    await context.close();
  }
}

/** Surfaces, a program without its job, and a record that grows. */
async function whatIsServed() {
  const surface = join(out, 'surface');
  spawnSync(program, ['workspace', 'hexapod-strut', '--tilt', '20', '--rel-tol', '0.2', '--resolution', '8', '--stl', `${surface}.stl`, '--vtp', `${surface}.vtp`], { cwd: root });
  const [head, ...rows] = readFileSync(record, 'utf8').trim().split('\n');
  const live = join(out, 'live.csv');
  writeFileSync(live, `${head}\n`);
  const { child, ended, address } = await start(`${surface}.stl`, `${surface}.vtp`, `${square}/program.ngc`, live, 'hexapod-strut');
  // The records come first.
  await served('view: an STL file', `${address}1`, async (page) => {
    check('view: an STL file', (await page.locator('main').innerText()).includes('The surface is closed'), 'the workspace is not closed');
  });
  await served('view: a VTP file', `${address}2`, async (page) => {
    check('view: a VTP file', (await page.locator('.legend').innerText()).includes('limit '), 'it has no legend of its limits');
  });
  await served('view: a program', `${address}4`, async (page) => {
    const row = page.locator('tr.picks').nth(2);
    await page.locator('figure.scene').first().scrollIntoViewIfNeeded();
    check('view: a program', await turned(page, () => row.evaluate((e) => e.click())), 'a line that is picked does not show in the path');
  });
  const name = 'view: a growing record';
  await served(name, `${address}0/live`, async (page) => {
    await page.getByText('The record has no rows yet').waitFor({ timeout: 10000 });
    // A hundred rows a second, each with the time at which it is written, along the motion there and back.
    const begin = Date.now();
    let written = 0;
    const write = () => {
      let text = '';
      for (; written < (Date.now() - begin) / 10; ++written) {
        const there = (10 * written) % (2 * rows.length - 2);
        text += `${written / 100},${rows[there < rows.length ? there : 2 * rows.length - 2 - there].split(',').slice(1).join(',')}\n`;
      }
      if (text !== '') appendFileSync(live, text);
    };
    const writer = setInterval(write, 10);
    const second = await (await browser.newContext()).newPage();
    await page.waitForFunction(() => /[0-9] s/.test(document.querySelector('#live .reading')?.textContent ?? ''), null, { timeout: 30000 });
    const frames = () => page.evaluate(() => globalThis.polypodScenes[0].renderer.info.render.frame);
    const kSeconds = 5;
    const before = await frames(), since = Date.now();
    await page.waitForTimeout(1000 * kSeconds);
    const rate = ((await frames()) - before) / ((Date.now() - since) / 1000);
    console.log(`${name}: ${rate.toFixed(1)} pictures a second`);
    check(name, rate > 1, `${rate.toFixed(1)} pictures a second`); // in software, beside whatever else runs
    const shown = () => page.locator('#live .reading dd').first().innerText().then(parseFloat);
    const late = (Date.now() - begin) / 1000 - (await shown());
    check(name, late < 2, `it is ${late} s behind`);
    check(name, (await page.evaluate(() => globalThis.polypodScenes[0].lines.find((l) => l.data.layer === 'path of the tip').points.length / 3)) > 50, 'the tip has no path');
    await second.goto(`${address}0/live`);
    await second.waitForFunction(() => /[0-9] s/.test(document.querySelector('#live .reading')?.textContent ?? ''), null, { timeout: 60000 });
    check(name, (await second.locator('#live .still').innerText()).includes('rows read'), 'a second browser sees nothing');
    await second.context().close();
    await page.getByRole('button', { name: 'Pause' }).click();
    const paused = await shown();
    await page.waitForTimeout(300);
    check(name, (await shown()) === paused, 'paused it goes on');
    await page.getByRole('button', { name: 'Go on' }).click();
    clearInterval(writer);
    appendFileSync(live, '9999,7,0');
    await page.getByText(/No new row for [3-9] s. Its last line has no end yet \(8 bytes\)/).waitFor({ timeout: 10000 });
    // Begun anew, with a leg beyond its limit.
    const broken = rows[0].split(',');
    broken[8] = '99';
    writeFileSync(live, `${head}\n${broken.join(',')}\n`);
    await page.getByText('Not within the limits').waitFor({ timeout: 10000 });
    check(name, (await page.locator('#live .still').innerText()).startsWith('1 rows read'), `begun anew it says ${await page.locator('#live .still').innerText()}`);
    check(name, (await page.locator('#live dd.beyond').count()) === 1, 'the joint beyond its limit is not marked');
  });
  child.kill('SIGINT');
  check(name, (await ended).code === 130, 'Ctrl-C does not end it');
}

/** `polypod view`: the form against `polypod ik`, its manners, and its end. */
async function theServer() {
  const name = 'view';
  const { child, ended, address } = await start('hexapod-strut');
  check(name, /^http:\/\/127\.0\.0\.1:\d+\/$/.test(address), `it prints ${address}`);
  const context = await browser.newContext({ viewport: { width: 1200, height: 900 } });
  const page = await context.newPage();
  const { messages, requests } = heard(page);
  await page.goto(address);
  check(name, (await page.waitForSelector('figure.scene.live', { timeout: 20000 }).catch(() => null)) !== null, 'its scene does not come alive');
  const settled = () => page.waitForFunction(() => document.querySelector('#live dl')?.textContent.includes('condition'), null, { timeout: 10000 });
  await settled();
  const x = page.getByLabel('x, mm', { exact: true }), q1 = page.getByLabel('q1, mm', { exact: true });
  check(name, await turned(page, async () => {
    const answered = page.waitForResponse((r) => r.url().endsWith('/0/pose'));
    await x.fill('7.25');
    await answered;
    await page.waitForTimeout(200);
  }), 'a figure that is typed does not move the machine');
  const ik = JSON.parse(spawnSync(program, ['ik', 'hexapod-strut', '--pose=7.25,0,75,0,0,0', '--json'], { encoding: 'utf8' }).stdout);
  check(name, Math.abs(Number(await q1.inputValue()) - ik.solutions[0].joints[0]) < 1e-6, `q1 is ${await q1.inputValue()}, ik says ${ik.solutions[0].joints[0]}`);
  const computed = page.waitForResponse((r) => r.url().endsWith('/0/workspace'), { timeout: 60000 });
  await page.getByText('Compute the workspace').click();
  await computed;
  await page.waitForTimeout(500);
  check(name, (await page.locator('#live').innerText()).includes('mm³, certainly between'), 'it computes no workspace');
  check(name, (await page.locator('.legend li').count()) > 4, 'the workspace has no legend');
  // Every parameter by itself, folded; and a workspace that is given up.
  await page.getByText('Every part by itself').first().waitFor();
  check(name, (await page.locator('#live details input').count()) > 30, 'the form lacks single parameters');
  await page.getByLabel('base.radius_mm, mm', { exact: true }).fill('55');
  const command = "polypod info hexapod-strut --set 'base.radius_mm=55' -o changed.toml";
  check(name, (await page.locator('#live code').innerText()) === command, 'it does not say how the machine is kept');
  // A figure as the file has it is no change; the list below shows what is changed; a wrong figure leaves nothing of the machine before.
  const listed = page.locator('main dl div', { has: page.locator('dt', { hasText: /^base\.radius$/ }) }).locator('dd');
  const radius = page.getByLabel('base.radius_mm, mm', { exact: true });
  await page.waitForFunction(() => document.querySelector('main').textContent.includes('in the file'), null, { timeout: 5000 }).catch(() => {});
  check(name, (await listed.innerText()) === '55 mm (50 mm in the file)', `the list of figures says ${await listed.innerText()}`);
  await radius.fill('50');
  check(name, !(await page.locator('#live code').isVisible()), `what equals the file is kept: ${await page.locator('#live code').innerText()}`);
  await page.waitForFunction(() => !document.querySelector('main').textContent.includes('in the file'), null, { timeout: 5000 }).catch(() => {});
  check(name, (await listed.innerText()) === '50 mm', `as in the file the list of figures says ${await listed.innerText()}`);
  await settled();
  await radius.fill('-1');
  await page.locator('#live p.note').waitFor();
  check(name, (await page.locator('#live dl').innerText()).trim() === '', `beside an error stands ${await page.locator('#live dl').innerText()}`);
  await radius.fill('55');
  await settled();
  await page.getByText('Compute the workspace').click();
  await page.getByText('Cancel', { exact: true }).click();
  await page.waitForFunction(() => document.querySelector('#live')?.textContent.includes('Cancelled.'), null, { timeout: 5000 });
  await judge('view, axe', page);
  check(name, messages.length === 0, `the console says: ${messages.join(' | ')}`);
  check(name, requests.every((url) => url.startsWith(address)), `it asks for ${requests.join(' ')}`);
  // Another site's page may not ask, under whatever name it reaches the port.
  for (const [headers, status] of [[{}, 200], [{ Origin: 'http://evil.example' }, 403], [{ Host: 'evil.example' }, 403]]) {
    const got = await new Promise((done) => get(`${address}0`, { headers }, (r) => { r.resume(); done(r.statusCode); }));
    check(name, got === status, `${JSON.stringify(headers)} gives ${got}`);
  }
  const begin = Date.now();
  child.kill('SIGINT');
  const end = await ended;
  check(name, end.code === 130, `Ctrl-C ends it with ${JSON.stringify(end)}`);
  check(name, Date.now() - begin < 2000, `Ctrl-C takes ${Date.now() - begin} ms`);
  await context.close();
  const once = await start('lola50', '--once');
  const answered = await fetch(once.address);
  check(name, answered.status === 200 && (await answered.text()).includes('<canvas data-scene'), '--once serves no page');
  check(name, (await once.ended).code === 0, '--once does not end with 0');
}

/** The index of all pages above: as good a page as they are, with a picture of each that is drawn, and links that lead to them. */
async function theIndex() {
  const done = spawnSync(program, ['report', out, '--json'], { encoding: 'utf8', timeout: kPatience });
  const file = join(out, 'index.html');
  const listed = JSON.parse(done.stdout).pages;
  check('report', Object.keys(pages).every((name) => listed.includes(`${name}.html`)), `it lists ${listed}`);
  const { context, page, seen } = await open(file);
  const pictures = await page.locator('main img').evaluateAll((all) => all.map((i) => i.naturalWidth));
  check('report', pictures.length === listed.length && pictures.every((w) => w > 0), `its pictures are ${pictures} px wide`);
  await judge('report, axe', page);
  check('report', seen.messages.length === 0, `the console says: ${seen.messages.join(' | ')}`);
  const asked = seen.requests.filter((url) => url !== `file://${file}` && !url.startsWith('data:image/svg+xml,'));
  check('report', asked.length === 0, `it asks for ${asked.join(' ').slice(0, 200)}`);
  await page.locator('h4 a', { hasText: 'Workspace of' }).click();
  check('report', page.url() === `file://${join(out, 'workspace.html')}`, `a link leads to ${page.url()}`);
  await context.close();
}

async function withoutWebGl(name, file) {
  const none = await open(file, {}, () => {
    HTMLCanvasElement.prototype.getContext = () => null;
  });
  await none.page.waitForSelector('.still', { timeout: 20000 }).catch(() => null);
  check(name, (await none.page.locator('.still').count()) > 0, 'without WebGL it does not say why the picture stands');
  check(name, await none.page.locator('figure.scene .wide svg').first().isVisible(), 'without WebGL it has no picture');
  await none.context.close();
  const still = await open(file, { javaScriptEnabled: false });
  check(name, await still.page.locator('figure.scene .wide svg').first().isVisible(), 'without scripts it has no picture');
  check(name, !(await still.page.locator('canvas').first().isVisible()), 'without scripts an empty canvas shows');
  await still.context.close();
}

/** Whether these checks see what they are for. */
async function seesFaults(file) {
  const text = readFileSync(file, 'utf8');
  const page = await (await browser.newContext()).newPage();
  const messages = [];
  page.on('console', (m) => messages.push(m.text()));
  await page.route('**/*', (route) => route.fulfill({ contentType: 'text/html', body: text.replace('<h1>', '<img src="http://x.example/a.png" alt=""><script>window.evil = 1</script><h1>') }));
  await page.goto('http://page.example/');
  check('the policy', (await page.evaluate(() => globalThis.evil)) === undefined, 'a foreign script runs');
  check('the policy', messages.some((m) => /Content Security Policy/i.test(m)), 'a foreign picture is asked for');
  await page.context().close();
}

try {
  for (const [name, [command, hasScene]] of Object.entries(pages)) {
    if (option('--only') !== undefined && option('--only') !== name) continue;
    const file = join(out, `${name}.html`);
    const done = spawnSync(program, command.split(' ').map((word) => word.replaceAll('{measured}', measured).replaceAll('{page}', file).replace('{record}', record).replace('{study}', study)), { cwd: root, encoding: 'utf8', timeout: kPatience });
    check(name, existsSync(file), `no page: ${done.stderr}`);
    if (!existsSync(file)) continue;
    check(name, statSync(file).size < 2e6, `it has ${statSync(file).size} bytes`);
    await step(`${name}: look`, () => look(name, file, hasScene));
    if (name === 'pick') await step(`${name}: curves`, () => curvesHoldTheFigures(name, file));
    if (name === 'pick') await step(`${name}: stretch`, () => stretches(name, file));
    if (name === 'dexterity') await step(`${name}: maps`, () => mapsHoldTheirValues(name, file));
    if (name === 'calibrate') await step(`${name}: dots`, () => dotsHoldTheFigures(name, file));
    if (name === 'study') await step(`${name}: dots`, () => scatteredDotsAreRead(name, file));
    if (name === 'study') await step(`${name}: parallel coordinates`, () => linesTellTheirValues(name, file));
    if (name === 'correct') await step(`${name}: lines`, () => linesArePicked(name, file));
    const along = 'along the moves that cut, mm';
    if (name === 'check' || name === 'misfit') {
      await step(`${name}: plays`, async () => {
        const json = JSON.parse(done.stdout), frames = await plays(name, file, 'time, s', true);
        check(name, near(frames.at.at(-1), json.time_s), `it ends at ${frames.at.at(-1)} s, the JSON says ${json.time_s}`);
        check(name, frames.notes.some((n) => n !== '') === !json.ok, `the JSON says ${json.ok}, the pictures ${frames.notes.find((n) => n !== '')}`);
        check(name, json.ok === (name === 'check'), `it ${json.ok ? 'fits' : 'does not fit'}`);
        if (json.joint_ranges.length > 0) await jointsAreThoseOfTheJson(name, file, json);
      });
    }
    if (name === 'move') await step(`${name}: plays`, () => plays(name, file, 'time, s', false));
    if (name === 'predict') {
      await step(`${name}: plays`, async () => {
        const json = JSON.parse(done.stdout), frames = await plays(name, file, along, true);
        check(name, near(largest(frames, 'distance'), json.distance_max_um), `the largest distance is ${largest(frames, 'distance')}, the JSON says ${json.distance_max_um}`);
      });
    }
    if (name === 'correct') {
      await step(`${name}: plays`, async () => {
        const json = JSON.parse(done.stdout), frames = await plays(name, file, along, true);
        for (const [column, key] of [['distance, as it is', 'distance_before_um'], ['distance, corrected', 'distance_after_um']]) {
          check(name, near(largest(frames, column), json[key]), `${column} goes to ${largest(frames, column)}, the JSON says ${json[key]}`);
        }
      });
    }
    if (name === 'watch') {
      await step(`${name}: plays`, async () => {
        const json = JSON.parse(done.stdout), frames = await plays(name, file, 'time, s', false);
        check(name, near(largest(frames, 'deviation'), json.deviation_um.largest), `the largest deviation is ${largest(frames, 'deviation')}, the JSON says ${json.deviation_um.largest}`);
      });
    }
    if (name === 'workspace') {
      await step(`${name}: without WebGL`, () => withoutWebGl(name, file));
      await step(`${name}: places`, () => sceneStandsWhereItIs(name, file));
      await step(`${name}: poses`, () => posesAreThoseOfTheProgram(name, 'hexapod-strut', file));
      await step(`${name}: policy`, () => seesFaults(file));
    }
  }
  if (option('--only') === undefined || option('--only') === 'view') {
    await step('view', theServer);
    await step('view: pages', whatIsServed);
  }
  if (option('--only') === undefined) await step('report', theIndex);
} finally {
  await browser.close();
  if (keep === undefined) rmSync(out, { recursive: true, force: true });
}
assert.ok(checks > 0);
for (const problem of problems) console.log(problem);
console.log(`${checks} checks of pages in a browser, ${problems.length} failed`);
process.exit(problems.length > 0 ? 1 : 0);
