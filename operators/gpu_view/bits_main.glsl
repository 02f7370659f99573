// SPDX-License-Identifier: GPL-3.0-or-later
// Bits of words as textures give them back: some cards lose those of numbers that are none, or almost none.

void main() {
  ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
  if (pixel.x >= view.size.x || pixel.y >= view.size.y) return;
  imageStore(out_bits, pixel, uvec4(floatBitsToUint(texelFetch(words, pixel, 0).r)));
}
