// SPDX-License-Identifier: Apache-2.0
// One triangle over the whole target.
in vec3 position;

void main() { gl_Position = vec4(position.xy, 0.0, 1.0); }
