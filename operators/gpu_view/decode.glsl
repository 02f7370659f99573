// SPDX-License-Identifier: GPL-3.0-or-later
// Inputs and layers of the luminance mixture's decoder (methods 11). A group decodes 32 pixels with four threads each,
// its lane's parts: they share out children and corners, and of each layer they have 20 outputs each. So threads that
// run together read the same weights, and all of a group's values are in shared memory, below 32 KB.
//
// Loops have bounds from a uniform buffer: compilers unroll constant ones, which takes minutes.

#define LANES 32
#define HARMONIC_ROW 17
#define CORNER_ROW 42
#define VIEW_ROW 74
#define COVERED_ROW 83
GROUP_MEMORY float inputs[147 * LANES];  // rows that cells cover stay; the others are results of every second layer
GROUP_MEMORY float others[80 * LANES];

// Luminances that are mixed, of cells that this thread has found, and their rows among what is covered.
float lights[16];
int rows[16];
int found, lane, part;

#define V(row) inputs[(row) * LANES + lane]
#define W(row) others[(row) * LANES + lane]
#define EIGHT uint(view.bounds.x)
#define TWELVE view.bounds.y
#define SIXTEEN view.bounds.z
#define WIDE view.bounds.w
#define INPUTS view.counts.y

int coded_row(uint node) {
  if (int(node >> 5) >= view.counts.w) return -1;
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

void found_cell(int row, float covered, float light) {
  V(COVERED_ROW + row) = covered;
  rows[found] = row;
  lights[found] = light;
  found++;
}

// What children of a voxel cover of the pixel, by the faces of their own children that show, and their light.
void place_children(Frame f, uvec2 here, vec3 along) {
  uint first = 2u * uint(part);
  for (uint octant = first; octant < first + (EIGHT >> 2); octant++) {
    if (((here.y >> octant) & 1u) == 0u) continue;
    uint child = here.x + uint(bitCount(here.y & ((1u << octant) - 1u)));
    uvec2 words = node_words(child);
    float light[8];
    vec3 share[8];
    for (int k = 0; k < 8; k++) { light[k] = -1.0; share[k] = vec3(1.0); }
    uint inner = words.y & 255u, cell = words.x, ahead = 1u;
    if (inner == 0u) { inner = 255u; cell = child; ahead = 0u; }  // a leaf stands for all of its children
    for (uint inside_ = 0u; inside_ < EIGHT; inside_++) {
      if (((inner >> inside_) & 1u) == 0u) continue;
      uvec2 w = node_words(cell);
      uint place = turned(f, inside_);
      light[place] = luminance_along(cell, w, along);
      if ((w.y & BOXED) != 0u) share[place] = box_shares(f, w.x);
      cell += ahead;
    }
    uint seen = turned(f, octant);
    vec3 base = 2.0 * vec3(seen & 1u, (seen >> 1) & 1u, seen >> 2) + 0.5;
    float area = 0.0, shown = 0.0;
    for (int index = 0; index < TWELVE; index++) {
      int axis = index >> 2, one_ = axis == 0 ? 1 : 0, two_ = axis == 2 ? 1 : 2;
      uint near = uint(index & 1) << one_ | uint((index >> 1) & 1) << two_, far = near | 1u << axis;
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
    found_cell(int(seen), area / (4.0 * f.half_side * f.half_side), area > 0.0 ? shown / area : 0.0);
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
  found_cell(row, covered * (total / 16.0 / area) / (ratio * ratio), light / total);
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

void put_other(int row, vec4 v) {
  W(row) = v.x;
  W(row + 1) = v.y;
  W(row + 2) = v.z;
  W(row + 3) = v.w;
}

// First numbers of two corners' codes, cells around them, and their part of the mean code at the entry point.
void place_corners(Frame f, uint row, vec3 entry, vec3 along, vec3 up, float ratio) {
  vec4 low = vec4(0.0), high = vec4(0.0);
  vec2 end = vec2(0.0);
  uint upper = uint(part) >> 1, start = row_word(3u * row + upper), first = 2u * uint(part);
  if ((part & 1) != 0) {
    uint steps = row_word(3u * row + 2u);
    start += upper != 0u ? steps >> 16 : steps & 0xFFFFu;
  }
  for (uint corner = first; corner < first + (EIGHT >> 2); corner++) {
    uint at = start + (corner & 1u);
    uvec4 code = floatBitsToUint(texelFetch(codes, texel(at), 0));
    vec4 begin = vec4(unpackHalf2x16(code.x), unpackHalf2x16(code.y));
    float share = ((corner & 1u) != 0u ? entry.x : 1.0 - entry.x) * ((corner & 2u) != 0u ? entry.y : 1.0 - entry.y)
                * ((corner & 4u) != 0u ? entry.z : 1.0 - entry.z);
    low += share * begin;
    high += share * vec4(unpackHalf2x16(code.z), unpackHalf2x16(code.w));
    end += share * unpackHalf2x16(floatBitsToUint(texelFetch(code_ends, texel(at), 0).r));
    int side = CORNER_ROW + 4 * int(corner);
    V(side) = begin.x;
    V(side + 1) = begin.y;
    V(side + 2) = begin.z;
    V(side + 3) = begin.w;
    uvec4 near = floatBitsToUint(texelFetch(cells, texel(2u * at), 0));
    uvec4 far = floatBitsToUint(texelFetch(cells, texel(2u * at + 1u), 0));
    for (uint octant = 0u; octant < EIGHT; octant++) {
      uint word = octant < 4u ? near[octant] : far[octant - 4u];
      if (word != 0u && octant != 7u - corner) place_outer(f, word, corner, octant, entry, along, up, ratio);
    }
  }
  put_other(10 * part, low);
  put_other(10 * part + 4, high);
  W(10 * part + 8) = end.x;
  W(10 * part + 9) = end.y;
}

// All inputs of a voxel's pixel but the code, whose parts wait among the other values.
void place_inputs(uint node, uvec2 words, uint row, vec3 entry, vec3 along, vec3 up, float ratio) {
  Frame f = make_frame(entry, along, up, ratio);
  place_children(f, words, along);
  place_corners(f, row, entry, along, up, ratio);
  if (part == 0) place_harmonics(along);
  if (part == 1) {
    for (int k = 0; k < 3; k++) { V(10 + k) = along[k]; V(13 + k) = up[k]; }
    V(16) = ratio;
  }
}

void place_code() {
  for (int k = part; k < 10; k += SIXTEEN >> 2) {
    float mean = W(k) + W(10 + k) + W(20 + k) + W(30 + k);
    V(k) = k < 9 ? mean * V(HARMONIC_ROW + k) : mean;
  }
}

void put(int row, vec4 v) {
  V(row) = v.x;
  V(row + 1) = v.y;
  V(row + 2) = v.z;
  V(row + 3) = v.w;
}

// A thread's 20 outputs of a layer, of values by FROM, stored by PUT.
#define LAYER(WEIGHTS, BIAS, DEPTH, FROM, PUT, FLOOR) { \
    int at = 5 * part; \
    vec4 a = layer_2.b[BIAS + at], b = layer_2.b[BIAS + at + 1], c = layer_2.b[BIAS + at + 2]; \
    vec4 d = layer_2.b[BIAS + at + 3], e = layer_2.b[BIAS + at + 4]; \
    for (int k = 0; k < DEPTH; k++) { \
      float v = FROM(k); \
      a += v * WEIGHTS[at]; b += v * WEIGHTS[at + 1]; c += v * WEIGHTS[at + 2]; \
      d += v * WEIGHTS[at + 3]; e += v * WEIGHTS[at + 4]; \
      at += 20; \
    } \
    at = 20 * part; \
    PUT(at, max(a, FLOOR)); PUT(at + 4, max(b, FLOOR)); PUT(at + 8, max(c, FLOOR)); \
    PUT(at + 12, max(d, FLOOR)); PUT(at + 16, max(e, FLOOR)); \
  }

// Largest logit of what this thread mixes; with it, the sum of shares (x) and of shares times luminances (y).
float largest_logit() {
  float most = V(65);
  for (int k = 0; k < found; k++) if (V(COVERED_ROW + rows[k]) > 0.0) most = max(most, V(1 + rows[k]));
  return most;
}

vec2 mixed(float most) {
  vec2 sums = vec2(0.0);
  for (int k = 0; k < found; k++) {
    float share = exp(clamp(V(1 + rows[k]) - most, -80.0, 0.0)) * V(COVERED_ROW + rows[k]);
    sums += share * vec2(1.0, lights[k]);
  }
  return sums;
}

float coverage() { return clamp(3.0 / (1.0 + exp(clamp(-V(0), -80.0, 80.0))) - 1.0, 0.0, 1.0); }
