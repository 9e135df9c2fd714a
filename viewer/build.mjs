// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Bundles the scripts of the pages into dist/, which is kept in the repository: the same sources give the same bytes.
//
//   dist/page.js        the script of every page, as it stands in it
//   dist/live.js        the script of pages that `polypod view` serves
//   dist/viewer.b64     the viewer of scenes: compressed (deflate) in base64, as it stands in a page
//   dist/hashes.cmake   SHA-256 (base64) of all before they are compressed: what the pages' policy allows
//   dist/licences.txt   the licences of what is bundled
//
// Usage: node build.mjs [--out DIR]
import { createHash } from 'node:crypto';
import { mkdirSync, readFileSync, writeFileSync } from 'node:fs';
import { dirname, join } from 'node:path';
import { fileURLToPath } from 'node:url';
import { build } from 'esbuild';
import { deflateSync } from 'fflate';

const here = dirname(fileURLToPath(import.meta.url));
const at = process.argv.indexOf('--out');
const out = at > 0 ? process.argv[at + 1] : join(here, 'dist');
mkdirSync(out, { recursive: true });

const options = { bundle: true, minify: true, format: 'iife', target: 'es2022', charset: 'ascii', legalComments: 'none', write: false, absWorkingDir: here, metafile: true };
async function bundle(entry) {
  const made = await build({ ...options, entryPoints: [entry] });
  const text = made.outputFiles[0].text.trimEnd();
  if (/<\/script|<!--/i.test(text)) throw new Error(`${entry}: the bundle holds what ends a script in a page`);
  const packages = new Set(Object.keys(made.metafile.inputs).flatMap((f) => /node_modules\/((?:@[^/]+\/)?[^/]+)/.exec(f)?.[1] ?? []));
  return { text, packages };
}

const page = await bundle('src/page.ts');
const live = await bundle('src/live.ts');
const viewer = await bundle('src/viewer.ts');
if (page.packages.size + live.packages.size > 0) throw new Error('the script of every page holds a package');
const packed = Buffer.from(deflateSync(Buffer.from(viewer.text), { level: 9, mem: 12 })).toString('base64');
const kMost = 300_000; // bytes of compressed script in a page
if (page.text.length + packed.length > kMost) throw new Error(`${page.text.length + packed.length} bytes of script are more than ${kMost}`);
const licences = [...viewer.packages].sort().map((name) => {
  const folder = join(here, 'node_modules', name);
  const { version } = JSON.parse(readFileSync(join(folder, 'package.json'), 'utf8'));
  return `${name} ${version}\n\n${readFileSync(join(folder, 'LICENSE'), 'utf8').trim()}\n`;
});
writeFileSync(join(out, 'page.js'), page.text + '\n');
writeFileSync(join(out, 'live.js'), live.text + '\n');
writeFileSync(join(out, 'viewer.b64'), packed + '\n');
const hash = (text) => createHash('sha256').update(text).digest('base64');
writeFileSync(join(out, 'hashes.cmake'), `set(page_sha256 ${hash(page.text)})\nset(live_sha256 ${hash(live.text)})\nset(viewer_sha256 ${hash(viewer.text)})\n`);
writeFileSync(join(out, 'licences.txt'), licences.join('\n'));
console.log(`page ${page.text.length} bytes; viewer ${viewer.text.length} bytes, ${packed.length} in a page; bundled: ${[...viewer.packages].join(', ')}`);
