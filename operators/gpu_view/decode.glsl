// SPDX-License-Identifier: GPL-3.0-or-later
// Inputs and layers of the luminance mixture's decoder (methods 11). A thread has a column of `values`: 147 rows of
// inputs, then 80 of a layer's results, which go to and fro; rows that cells cover stay, as on the CPU.
//
// Loops have bounds from a uniform buffer: compilers unroll constant ones, which takes minutes.

#ifdef GROUP_MEMORY  // `shared`, by a define, since Blender 5.2 takes the word itself out of sources
#define GROUP 32
#else
#define GROUP 1
#define GROUP_MEMORY
#endif
#define HARMONIC_ROW 17
#define CORNER_ROW 42
#define VIEW_ROW 74
#define COVERED_ROW 83
#define OTHER 147
GROUP_MEMORY float values[(OTHER + 80) * GROUP];
float lights[65];  // that are mixed: of children, cells around, the voxel itself
int column;        // of this thread

#define V(row) values[(row) * GROUP + column]
#define EIGHT uint(view.bounds.x)
#define TWELVE view.bounds.y
#define TWENTY view.bounds.z
#define WIDE view.bounds.w
#define INPUTS view.counts.y

int coded_row(uint node) {
  if (int(node >> 5) >= CODED_WORDS) return -1;
  uvec4 found = ranks_at(node);
  return ((found.y >> (node & 31u)) & 1u) == 0u ? -1 : int(rank_of(found.x, found.y, node));
}

uint row_word(uint at) { return floatBitsToUint(texelFetch(corner_rows, texel(at), 0).r); }

// How a pixel sees cells, in the ray's frame: octree axes and mirrored ones, the picture's axes, half sides of faces.
struct Frame {
  ivec3 axes;
  uint flips;
  vec3 right, up, wide, high;
  vec2 start;
  float half_side;
};

Frame make_frame(vec3 entry, vec3 along, vec3 up, float ratio) {
  Frame f;
  int a = 0, b = 1, c = 2, s;
  vec3 size = abs(along);
  if (size[a] < size[b]) { s = a; a = b; b = s; }
  if (size[b] < size[c]) { s = b; b = c; c = s; }
  if (size[a] < size[b]) { s = a; a = b; b = s; }
  f.axes = ivec3(a, b, c);
  f.flips = (along.x < 0.0 ? 1u : 0u) | (along.y < 0.0 ? 2u : 0u) | (along.z < 0.0 ? 4u : 0u);
  vec3 right = cross(along, up);
  f.start = vec2(0.0);
  for (int k = 0; k < 3; k++) {
    int axis = f.axes[k];
    float sign_ = along[axis] < 0.0 ? -1.0 : 1.0;
    float point = sign_ < 0.0 ? 1.0 - entry[axis] : entry[axis];
    f.right[k] = sign_ * right[axis];
    f.up[k] = sign_ * up[axis];
    V(VIEW_ROW + k) = abs(along[axis]);
    V(VIEW_ROW + 3 + k) = 2.0 * point - 1.0;
    V(VIEW_ROW + 6 + k) = f.up[k];
    f.start -= point * vec2(f.right[k], f.up[k]);
  }
  vec3 r = abs(f.right), u = abs(f.up), ahead = vec3(size[a], size[b], size[c]);
  f.wide = 0.125 * (vec3(r.x + r.y + r.z) - r);
  f.high = 0.125 * (vec3(u.x + u.y + u.z) - u);
  vec3 scale = sqrt(0.0625 * ahead / (4.0 * f.wide * f.high + 1e-9));
  f.wide *= scale;
  f.high *= scale;
  f.half_side = 0.5 * ratio;
  return f;
}

float inside(float middle, float reach, float half_side) {
  return max(min(middle + reach, half_side) - max(middle - reach, -half_side), 0.0);
}

float overlap(Frame f, vec3 middle, int axis) {
  return inside(f.start.x + dot(middle, f.right), f.wide[axis], f.half_side)
       * inside(f.start.y + dot(middle, f.up), f.high[axis], f.half_side);
}

uint turned(Frame f, uint octant) {  // octant of the octree as one of the frame
  uint o = octant ^ f.flips;
  return ((o >> f.axes.x) & 1u) | ((o >> f.axes.y) & 1u) << 1 | ((o >> f.axes.z) & 1u) << 2;
}

// Shares of a box's voxel's faces that it covers, by axes of the frame.
vec3 box_shares(Frame f, uint box) {
  vec3 side = vec3(1u + ((box >> 4) & 15u) - (box & 15u), 1u + ((box >> 12) & 15u) - ((box >> 8) & 15u),
                   1u + ((box >> 20) & 15u) - ((box >> 16) & 15u));
  vec3 covered = side.yxx * side.zzy / 256.0;
  return vec3(covered[f.axes.x], covered[f.axes.y], covered[f.axes.z]);
}

// What the children of a voxel cover of the pixel, by the faces of their own children that show, and their light.
void place_children(Frame f, uvec2 here, vec3 along) {
  uint child = here.x;
  for (uint octant = 0u; octant < EIGHT; octant++) {
    if (((here.y >> octant) & 1u) == 0u) continue;
    uvec2 words = node_words(child);
    float light[8];
    vec3 share[8];
    for (int k = 0; k < 8; k++) { light[k] = -1.0; share[k] = vec3(1.0); }
    uint inner = words.y & 255u, cell = words.x, ahead = 1u;
    if (inner == 0u) { inner = 255u; cell = child; ahead = 0u; }  // a leaf stands for all of its children
    for (uint part = 0u; part < EIGHT; part++) {
      if (((inner >> part) & 1u) == 0u) continue;
      uvec2 w = node_words(cell);
      uint place = turned(f, part);
      light[place] = luminance_along(cell, w, along);
      if ((w.y & BOXED) != 0u) share[place] = box_shares(f, w.x);
      cell += ahead;
    }
    uint seen = turned(f, octant);
    vec3 base = 2.0 * vec3(seen & 1u, (seen >> 1) & 1u, seen >> 2) + 0.5;
    float area = 0.0, shown = 0.0;
    for (int index = 0; index < TWELVE; index++) {
      int axis = index >> 2, first = axis == 0 ? 1 : 0, second = axis == 2 ? 1 : 2;
      uint near = uint(index & 1) << first | uint((index >> 1) & 1) << second, far = near | 1u << axis;
      vec3 middle = base + vec3(near & 1u, (near >> 1) & 1u, near >> 2);
      middle[axis] -= 0.5;
      float before = light[near] < 0.0 ? 0.0 : share[near][axis];
      float behind = light[far] < 0.0 ? 0.0 : share[far][axis] * (1.0 - before);
      float one = before * overlap(f, middle * 0.25, axis);
      middle[axis] += 1.0;
      float two = behind * overlap(f, middle * 0.25, axis);
      area += one + two;
      shown += one * light[near] + two * light[far];
    }
    V(COVERED_ROW + int(seen)) = area / (4.0 * f.half_side * f.half_side);
    lights[seen] = area > 0.0 ? shown / area : 0.0;
    child++;
  }
}

uint lower_half(int axis) { return axis == 0 ? 0x55u : axis == 1 ? 0x33u : 0x0Fu; }

// Luminance of the lower or upper face of a cell around a corner (`corner_cells.py` says what a word is).
float face_light(uint word, int axis, bool upper) {
  float mean = float((word >> 8) & 255u) * (1.0 / 255.0);
  float steps = float(int((word >> (16 + 5 * axis)) & 31u) - 15) * (1.0 / 15.0);
  float slope = 0.5 * steps * abs(steps);
  float root = clamp(upper ? mean + slope : mean - slope, 0.0, 1.0);
  return root * root;
}

// Row of a cell of 4x4x4 among those that are not in the voxel: inner ones have 1 and 2 on each axis.
int outer_row(uint x, uint y, uint z) {
  uint before = 4u * clamp(z, 1u, 3u) - 4u;
  if (z == 1u || z == 2u) {
    before += 2u * clamp(y, 1u, 3u) - 2u;
    if (y == 1u || y == 2u) before += clamp(x, 1u, 3u) - 1u;
  }
  return int(x + 4u * y + 16u * z - before);
}

void place_outer(Frame f, uint word, uint corner, uint octant, vec3 entry, vec3 along, vec3 up, float ratio) {
  vec3 right = cross(along, up), middle, halves, seen;
  uvec3 place;
  float light = 0.0;
  uint mask = word & 255u;
  for (int k = 0; k < 3; k++) {
    uint low = lower_half(k);
    float lower = (mask & low) != 0u ? 1.0 : 0.0, upper = (mask & ~low) != 0u ? 1.0 : 0.0;
    uint at = 2u * ((corner >> k) & 1u) + ((octant >> k) & 1u);
    middle[k] = 0.5 * float(at) - 0.25 + 0.125 * (upper - lower);
    halves[k] = 0.125 * (upper + lower);
    seen[k] = abs(along[k]) * float(bitCount((mask | mask >> (1 << k)) & low));
    light += seen[k] * face_light(word, k, along[k] < 0.0);
    place[k] = along[k] < 0.0 ? 3u - at : at;
  }
  vec3 size = abs(along);
  float area = 4.0 * (size.x * halves.y * halves.z + size.y * halves.x * halves.z + size.z * halves.x * halves.y);
  float wide = dot(halves, abs(right)), high = dot(halves, abs(up)), half_side = 0.5 * ratio;
  float scale = sqrt(area / (4.0 * wide * high + 1e-9));
  float covered = inside(dot(middle - entry, right), wide * scale, half_side)
                * inside(dot(middle - entry, up), high * scale, half_side);
  float total = seen.x + seen.y + seen.z;
  int row = 8 + outer_row(place[f.axes.x], place[f.axes.y], place[f.axes.z]);
  V(COVERED_ROW + row) = covered * (total / 16.0 / area) / (ratio * ratio);
  lights[row] = light / total;
}

void place_harmonics(vec3 d) {
  float x = d.x, y = d.y, z = d.z, xx = x * x, yy = y * y, zz = z * z, xy = x * y, yz = y * z, xz = x * z;
  int h = HARMONIC_ROW;
  V(h) = 0.28209479177387814;
  V(h + 1) = 0.4886025119029199 * y;
  V(h + 2) = 0.4886025119029199 * z;
  V(h + 3) = 0.4886025119029199 * x;
  V(h + 4) = 1.0925484305920792 * xy;
  V(h + 5) = 1.0925484305920792 * yz;
  V(h + 6) = 0.31539156525252005 * (3.0 * zz - 1.0);
  V(h + 7) = 1.0925484305920792 * xz;
  V(h + 8) = 0.5462742152960396 * (xx - yy);
  V(h + 9) = 0.5900435899266435 * y * (3.0 * xx - yy);
  V(h + 10) = 2.890611442640554 * xy * z;
  V(h + 11) = 0.4570457994644658 * y * (5.0 * zz - 1.0);
  V(h + 12) = 0.3731763325901154 * z * (5.0 * zz - 3.0);
  V(h + 13) = 0.4570457994644658 * x * (5.0 * zz - 1.0);
  V(h + 14) = 1.445305721320277 * z * (xx - yy);
  V(h + 15) = 0.5900435899266435 * x * (xx - 3.0 * yy);
  V(h + 16) = 2.5033429417967046 * xy * (xx - yy);
  V(h + 17) = 1.7701307697799304 * yz * (3.0 * xx - yy);
  V(h + 18) = 0.9461746957575601 * xy * (7.0 * zz - 1.0);
  V(h + 19) = 0.6690465435572892 * yz * (7.0 * zz - 3.0);
  V(h + 20) = 0.10578554691520431 * (35.0 * zz * zz - 30.0 * zz + 3.0);
  V(h + 21) = 0.6690465435572892 * xz * (7.0 * zz - 3.0);
  V(h + 22) = 0.47308734787878004 * (xx - yy) * (7.0 * zz - 1.0);
  V(h + 23) = 1.7701307697799304 * xz * (xx - 3.0 * yy);
  V(h + 24) = 0.6258357354491761 * (xx * xx - 6.0 * xx * yy + yy * yy);
}

// Mean code at the entry point, first numbers of each corner's, and the cells around the corners.
void place_corners(Frame f, uint row, vec3 entry, vec3 along, vec3 up, float ratio) {
  vec4 low = vec4(0.0), high = vec4(0.0);
  vec2 end = vec2(0.0);
  uvec3 rows = uvec3(row_word(3u * row), row_word(3u * row + 1u), row_word(3u * row + 2u));
  for (uint corner = 0u; corner < EIGHT; corner++) {
    uint at = ((corner & 4u) != 0u ? rows.y : rows.x) + (corner & 1u);
    if ((corner & 2u) != 0u) at += (corner & 4u) != 0u ? rows.z >> 16 : rows.z & 0xFFFFu;
    uvec4 code = floatBitsToUint(texelFetch(codes, texel(at), 0));
    vec4 first = vec4(unpackHalf2x16(code.x), unpackHalf2x16(code.y));
    float share = ((corner & 1u) != 0u ? entry.x : 1.0 - entry.x) * ((corner & 2u) != 0u ? entry.y : 1.0 - entry.y)
                * ((corner & 4u) != 0u ? entry.z : 1.0 - entry.z);
    low += share * first;
    high += share * vec4(unpackHalf2x16(code.z), unpackHalf2x16(code.w));
    end += share * unpackHalf2x16(floatBitsToUint(texelFetch(code_ends, texel(at), 0).r));
    int side = CORNER_ROW + 4 * int(corner);
    V(side) = first.x;
    V(side + 1) = first.y;
    V(side + 2) = first.z;
    V(side + 3) = first.w;
    uvec4 near = floatBitsToUint(texelFetch(cells, texel(2u * at), 0));
    uvec4 far = floatBitsToUint(texelFetch(cells, texel(2u * at + 1u), 0));
    for (uint octant = 0u; octant < EIGHT; octant++) {
      uint word = octant < 4u ? near[octant] : far[octant - 4u];
      if (word != 0u && octant != 7u - corner) place_outer(f, word, corner, octant, entry, along, up, ratio);
    }
  }
  V(0) = low.x * V(HARMONIC_ROW);
  V(1) = low.y * V(HARMONIC_ROW + 1);
  V(2) = low.z * V(HARMONIC_ROW + 2);
  V(3) = low.w * V(HARMONIC_ROW + 3);
  V(4) = high.x * V(HARMONIC_ROW + 4);
  V(5) = high.y * V(HARMONIC_ROW + 5);
  V(6) = high.z * V(HARMONIC_ROW + 6);
  V(7) = high.w * V(HARMONIC_ROW + 7);
  V(8) = end.x * V(HARMONIC_ROW + 8);
  V(9) = end.y;
}

void place_inputs(uint node, uvec2 words, uint row, vec3 entry, vec3 along, vec3 up, float ratio) {
  for (uint k = 0u; k < 8u * EIGHT; k++) { V(COVERED_ROW + int(k)) = 0.0; lights[k] = 0.0; }
  lights[64] = luminance_along(node, words, along);
  Frame f = make_frame(entry, along, up, ratio);
  place_children(f, words, along);
  place_harmonics(along);
  place_corners(f, row, entry, along, up, ratio);
  for (int k = 0; k < 3; k++) { V(10 + k) = along[k]; V(13 + k) = up[k]; }
  V(16) = ratio;
}

// A layer: 20 outputs at a time, from rows of the thread's column to others.
#define LAYER(W, B, DEPTH, FROM, TO, FLOOR) \
  for (int block = 0; block < TWENTY; block += 5) { \
    vec4 a = layer_2.b[B + block], b = layer_2.b[B + block + 1], c = layer_2.b[B + block + 2]; \
    vec4 d = layer_2.b[B + block + 3], e = layer_2.b[B + block + 4]; \
    for (int row = 0; row < DEPTH; row++) { \
      float v = V(FROM + row); \
      int at = row * 20 + block; \
      a += v * W[at]; b += v * W[at + 1]; c += v * W[at + 2]; d += v * W[at + 3]; e += v * W[at + 4]; \
    } \
    put(TO + 4 * block, max(a, FLOOR)); put(TO + 4 * block + 4, max(b, FLOOR)); put(TO + 4 * block + 8, max(c, FLOOR)); \
    put(TO + 4 * block + 12, max(d, FLOOR)); put(TO + 4 * block + 16, max(e, FLOOR)); \
  }

void put(int row, vec4 v) {
  V(row) = v.x;
  V(row + 1) = v.y;
  V(row + 2) = v.z;
  V(row + 3) = v.w;
}

// Coverage and luminance of the thread's column.
vec2 decode() {
  LAYER(layer_1.w, 0, INPUTS, 0, OTHER, vec4(0.0))
  LAYER(layer_2.w, 20, WIDE, OTHER, 0, vec4(0.0))
  LAYER(layer_3.w, 40, WIDE, 0, OTHER, vec4(0.0))
  LAYER(layer_4.w, 60, WIDE, OTHER, 0, vec4(-1e30))
  float most = V(65);
  for (int k = 0; k < 8 * int(EIGHT); k++) if (V(COVERED_ROW + k) > 0.0) most = max(most, V(1 + k));
  float total = exp(max(V(65) - most, -80.0)), light = total * lights[64];
  for (int k = 0; k < 8 * int(EIGHT); k++) {
    float share = exp(clamp(V(1 + k) - most, -80.0, 0.0)) * V(COVERED_ROW + k);
    total += share;
    light += share * lights[k];
  }
  return vec2(clamp(3.0 / (1.0 + exp(clamp(-V(0), -80.0, 80.0))) - 1.0, 0.0, 1.0), light / total);
}
