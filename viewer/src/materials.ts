// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// How surfaces and dots look: the light of the drawn pictures, cut off above and below two heights.

import { DoubleSide, ShaderMaterial, Vector2 } from 'three';

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
