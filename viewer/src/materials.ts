// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// How surfaces and dots look: the light of the drawn pictures, cut off above and below two heights.

import { Color, DoubleSide, ShaderMaterial, Vector2 } from 'three';

/** Shared by everything that the height cuts. */
export const cuts = { value: new Vector2(-1e30, 1e30) };

const kCut = `uniform vec2 cuts; varying vec3 place;
void keep() { if (place.z < cuts.x || place.z > cuts.y) discard; }`;

export function surfaceMaterial(opacity: number, height: { value: Vector2 }): ShaderMaterial {
  return new ShaderMaterial({
    side: DoubleSide,
    transparent: opacity < 1,
    depthWrite: opacity >= 1,
    vertexColors: true,
    polygonOffset: true,
    polygonOffsetFactor: 1,
    polygonOffsetUnits: 1,
    uniforms: { opacity: { value: opacity }, cuts: height },
    vertexShader: `varying vec3 place; varying vec3 turned; varying vec3 fill;
void main() { place = position; turned = normalMatrix * normal; fill = color; gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0); }`,
    // Light from the upper left, a little behind the eye; what is seen from behind is darker.
    fragmentShader: `${kCut} varying vec3 turned; varying vec3 fill; uniform float opacity;
void main() {
  keep();
  vec3 n = normalize(turned);
  vec3 light = normalize(vec3(-0.45, 0.55, 0.75));
  float shine = max(0.0, (gl_FrontFacing ? 1.0 : -1.0) * dot(n, light));
  float lightness = gl_FrontFacing ? 0.62 + 0.42 * shine : 0.48 + 0.34 * shine;
  gl_FragColor = vec4(min(fill * lightness, 1.0), opacity);
}`,
  });
}

export function dotMaterial(size: number, pixels: number): ShaderMaterial {
  return new ShaderMaterial({
    vertexColors: true,
    uniforms: { size: { value: size * pixels } },
    vertexShader: `varying vec3 fill; uniform float size;
void main() { fill = color; gl_PointSize = size; gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0); gl_Position.z -= 0.0005; }`,
    fragmentShader: `varying vec3 fill;
void main() { if (length(gl_PointCoord - 0.5) > 0.5) discard; gl_FragColor = vec4(fill, 1.0); }`,
  });
}

/**
 * Lines `width` CSS pixels wide, as rectangles of their own: every corner knows its own end of the segment, the other
 * end, and its side (1 or -1; the sides of the two ends are seen along opposite directions). Rectangles are half a width
 * longer than the segment at each end, so that corners are closed. Instances, as three's LineSegments2 has them, cost a
 * software renderer a draw each. The camera has no perspective.
 */
export function lineMaterial(width: number, coloured: boolean): ShaderMaterial {
  return new ShaderMaterial({
    side: DoubleSide,
    vertexColors: coloured,
    uniforms: { width: { value: width }, resolution: { value: new Vector2(1, 1) }, colour: { value: new Color() } },
    vertexShader: `attribute vec3 other; attribute float side; varying vec3 fill; uniform float width; uniform vec2 resolution; uniform vec3 colour;
void main() {
  fill = ${coloured ? 'color' : 'colour'};
  gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0);
  vec2 along = (projectionMatrix * modelViewMatrix * vec4(other, 1.0)).xy - gl_Position.xy;
  along *= resolution;
  along = length(along) > 1e-6 ? normalize(along) : vec2(1.0, 0.0);
  gl_Position.xy += width * (side * vec2(-along.y, along.x) - along) / resolution;
}`,
    fragmentShader: `varying vec3 fill;
void main() { gl_FragColor = vec4(fill, 1.0); }`,
  });
}
