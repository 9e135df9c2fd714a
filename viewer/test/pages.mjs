// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Opens pages of results in a browser and does with them what a reader does.
//
// Usage: node test/pages.mjs PROGRAM [--keep DIR] [--only NAME]
//
// Every page opens without a message on the console and without a request to anything but itself; it fits a screen of
// 390 px; axe-core finds no serious fault in light and dark. A page with a picture in space has a canvas that turns by mouse and keys and comes
// back with 0, and shows its drawn picture on paper, without scripts and without WebGL.
import assert from 'node:assert/strict';
import { spawnSync } from 'node:child_process';
import { existsSync, mkdirSync, mkdtempSync, readFileSync, rmSync, statSync } from 'node:fs';
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
  pick: ['pick delta-brno --from 150,0,600 --to -150,0,600 --report {page}', true],
  dexterity: ['dexterity hexapod-strut --resolution 8 --report {page}', true],
  correct: [`correct ${square}/program.ngc --job ${square}/job.toml -o {page}.ngc --report {page}`, true],
  map: ['map lola50 --at 0 --x -600,600 --y -1600,-1000 --resolution 5 -o {page}', false],
};

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

/** A page in a window of its own; `seen` collects what it says and asks for. */
async function open(file, options = {}, before = undefined) {
  const context = await browser.newContext({ viewport: { width: 1200, height: 900 }, ...options });
  const page = await context.newPage();
  const seen = { messages: [], requests: [] };
  page.on('console', (m) => ['error', 'warning'].includes(m.type()) && seen.messages.push(m.text()));
  page.on('pageerror', (e) => seen.messages.push(String(e)));
  page.on('request', (q) => seen.requests.push(q.url()));
  if (before) await page.addInitScript(before);
  await page.goto(`file://${file}`);
  return { context, page, seen };
}
const pixels = (page) => page.locator('canvas[data-scene]').first().evaluate((c) => c.toDataURL());
const settle = (page) => page.evaluate(() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done))));
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
  await judge(`${name}, axe`, page);
  await page.emulateMedia({ colorScheme: 'dark' });
  await settle(page);
  await judge(`${name}, axe, dark`, page);
  await page.emulateMedia({ media: 'print', colorScheme: 'light' });
  check(name, await page.locator('svg.pp').first().isVisible(), 'on paper it has no picture');
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
    const done = spawnSync(program, command.split(' ').map((word) => word.replaceAll('{page}', file)), { cwd: root, encoding: 'utf8' });
    check(name, existsSync(file), `no page: ${done.stderr}`);
    if (!existsSync(file)) continue;
    check(name, statSync(file).size < 4e6, `it has ${statSync(file).size} bytes`);
    await look(name, file, hasScene);
    if (name === 'workspace') {
      await withoutWebGl(name, file);
      await posesAreThoseOfTheProgram(name, 'hexapod-strut', file);
      await seesFaults(file);
    }
  }
} finally {
  await browser.close();
  if (keep === undefined) rmSync(out, { recursive: true, force: true });
}
assert.ok(checks > 0);
for (const problem of problems) console.log(problem);
console.log(`${checks} checks of pages in a browser, ${problems.length} failed`);
process.exit(problems.length > 0 ? 1 : 0);
