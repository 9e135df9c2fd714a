// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What a page holds of a scene (written by src/report/scene_data.cpp), and how it is unpacked.

import { shorts } from './packed';

export type Vec = [number, number, number];

/** Numbers in steps: value = low + step * whole number; 65535 stands for none. */
export interface Steps {
  low: number[];
  step: number[];
  data: string; // base64 of unsigned 16-bit numbers, little-endian
}

export interface MeshData {
  name: string;
  opacity: number;
  points: Steps;
  triangles: string; // base64 of unsigned 32-bit numbers, three a triangle
  kind?: string; // base64 of signed 8-bit numbers, one a point
  value?: Steps; // one a point
  // From the place `at` of the first frames on, a point lies `by` along `along` from where it lies in `points`: rising.
  shifts?: { along: Vec; at: string; point: string; by: string }; // base64 of 32-bit floats, unsigned numbers, floats
}

export interface LineData {
  name: string;
  colour: string; // of the page's colours: ink, muted, blue, ...
  stroke: number; // px
  dots: boolean;
  moves: boolean; // its points are those of the frames, where there are any
  layer: string; // what a switch shows and hides together
  points: string | Float32Array; // three a point; NaN interrupts; in a page base64 of 32-bit floats
  value?: string; // base64 of 32-bit floats, one a point: the colour
  tag?: number[]; // what each point belongs to, e.g. the line of a program
}

export interface FramesData {
  name: string; // "time", "x"
  unit: string;
  plays: boolean; // over time: it can be played
  at: number[];
  points: Steps; // three a point of the lines that move, frame after frame
  columns: { name: string; unit: string; values: (number | null)[] }[]; // read out beside the slider
  notes: (string | null)[]; // what is wrong in a frame
  texts?: (string | null)[]; // what is going on in a frame, e.g. the line of the program
  start: number; // the frame that is shown first
}

export interface SceneData {
  title: string;
  unit: string;
  axes: [string, string, string];
  view: [number, number];
  low: Vec;
  high: Vec;
  kinds: { name: string; fill: string; shown: boolean }[];
  none: string; // the colour of points without a kind
  levels: number[];
  meshes: MeshData[];
  lines: LineData[];
  frames: FramesData[];
  shift?: { name: string; lines: number[]; offsets: string[]; most: number; at: number };
  colours?: { name: string; unit: string; low: number; high: number; map: string[] };
}

export function unpacked(steps: Steps): Float32Array {
  const packed = shorts(steps.data);
  const n = steps.low.length;
  const out = new Float32Array(packed.length);
  for (let i = 0; i < packed.length; ++i) {
    const whole = packed[i]!;
    out[i] = whole === 65535 ? NaN : steps.low[i % n]! + steps.step[i % n]! * whole;
  }
  return out;
}
