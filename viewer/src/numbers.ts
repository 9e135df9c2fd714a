// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Numbers for people: steps of axes as src/report/svg.cpp has them, and a minus sign instead of a hyphen. Unlike there,
// thousands stand without spaces.

export const kMinus = '\u2212';

/** Round values that cover low..high with about `count` steps of 1, 2 or 5 times a power of ten. */
export function ticks(low: number, high: number, count: number): number[] {
  if (!(high > low)) return [];
  const rough = (high - low) / Math.max(1, count);
  const power = 10 ** Math.floor(Math.log10(rough));
  const ratio = rough / power;
  const step = power * (ratio < Math.SQRT2 ? 1 : ratio < Math.sqrt(10) ? 2 : ratio < Math.sqrt(50) ? 5 : 10);
  const out: number[] = [];
  for (let i = Math.ceil(low / step - 1e-9); i <= Math.floor(high / step + 1e-9) && out.length < 100; ++i) out.push(i * step);
  return out;
}

export function fixed(value: number, decimals: number): string {
  if (!Number.isFinite(value)) return 'n/a';
  const text = Math.abs(value).toFixed(Math.max(0, Math.min(12, decimals)));
  return (value < 0 && Number(text) !== 0 ? kMinus : '') + text;
}

/** With as many decimals as a difference of `span` / 1000 needs. */
export function shown(value: number, span: number): string {
  return fixed(value, Math.max(0, Math.min(6, 3 - Math.floor(Math.log10(span || 1) + 1e-9))));
}

/** With so many digits, and without zeros at the end. */
export function figure(value: number, digits: number): string {
  return Number.isFinite(value) ? String(Number(value.toPrecision(digits))).replaceAll('-', kMinus) : 'n/a';
}

export function decimalsOf(values: number[]): number {
  if (values.length < 2) return values.every(Number.isInteger) ? 0 : 2;
  return Math.max(0, Math.min(12, Math.ceil(-Math.log10(values[1]! - values[0]!) - 1e-9)));
}
