// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// Numbers as bytes in base64, as src/report/packed.hpp writes them: little-endian, whatever the machine is.

function bytes(text: string): DataView {
  const raw = atob(text);
  const out = new Uint8Array(raw.length);
  for (let i = 0; i < raw.length; ++i) out[i] = raw.charCodeAt(i);
  return new DataView(out.buffer);
}

export function floats(text: string): Float32Array {
  const view = bytes(text), out = new Float32Array(view.byteLength / 4);
  for (let i = 0; i < out.length; ++i) out[i] = view.getFloat32(4 * i, true);
  return out;
}
/** Unsigned, 32 bits. */
export function wholes(text: string): Uint32Array {
  const view = bytes(text), out = new Uint32Array(view.byteLength / 4);
  for (let i = 0; i < out.length; ++i) out[i] = view.getUint32(4 * i, true);
  return out;
}
/** Unsigned, 16 bits. */
export function shorts(text: string): Uint16Array {
  const view = bytes(text), out = new Uint16Array(view.byteLength / 2);
  for (let i = 0; i < out.length; ++i) out[i] = view.getUint16(2 * i, true);
  return out;
}
/** Signed, 8 bits. */
export const smalls = (text: string): Int8Array => new Int8Array(bytes(text).buffer);
/** Unsigned, 8 bits. */
export const octets = (text: string): Uint8Array => new Uint8Array(bytes(text).buffer);
