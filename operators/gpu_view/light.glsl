// SPDX-License-Identifier: GPL-3.0-or-later
// Light that a voxel shows along a direction (methods 7.2i): of three of its six faces, or its mean; in colour (7.2d).

float luminance_of(uvec2 words) { return float((words.y >> 8) & 65535u) * (1.0 / 65535.0); }

// Numbers among the coded nodes (x) and among those with sides (z), and bits that say whether a node is one (y, w).
uvec4 ranks_at(uint node) { return floatBitsToUint(texelFetch(ranks, texel(node >> 5), 0)); }

uint rank_of(uint before, uint bits, uint node) { return before + uint(bitCount(bits & ((1u << (node & 31u)) - 1u))); }

uint side_row(uint node) {
  uvec4 found = ranks_at(node);
  return rank_of(found.z, found.w, node);
}

// Of an axis of a row of sides: roots of the upper and the lower face's luminance, their shares; their hues.
uvec2 side_words(uint row, int axis) { return floatBitsToUint(texelFetch(sides, texel(3u * row + uint(axis)), 0).xy); }

// Luminance times weight, and weight, of the one of an axis's two faces that a direction runs against.
vec2 face_along(uint word, float along) {
  uint pair = along > 0.0 ? word >> 8 : word;
  float root = float(pair & 255u) * (1.0 / 255.0), weight = abs(along) * float((pair >> 16) & 255u);
  return vec2(weight * root * root, weight);
}

// Weight of the mean beside what is seen of faces: of what an inner node leaves open, and a little.
float rest_of(uvec2 words, float seen, vec3 along) {
  vec3 through = 255.0 * abs(along);
  return 1.0 + ((words.y & 255u) != 0u ? through.x + through.y + through.z - seen : 0.0);
}

float luminance_along(uint node, uvec2 words, vec3 along) {
  float mean = luminance_of(words);
  if ((words.y & SIDED) == 0u) return mean;
  uint row = side_row(node);
  vec2 faces = vec2(0.0);
  for (int axis = 0; axis < 3; axis++) faces += face_along(side_words(row, axis).x, along[axis]);
  float rest = rest_of(words, faces.y, along);
  return (rest * mean + faces.x) / (rest + faces.y);
}
