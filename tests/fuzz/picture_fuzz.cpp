// libFuzzer target: no bytes from an MJPEG camera make the decoder write beyond the picture, fail to return, spoil the
// next good picture, or accept a picture without having written all of it.
//   cmake -S . -B build/fuzz -G Ninja -DFINSIGHT_FUZZ=ON -DCMAKE_CXX_COMPILER=clang++
//   cmake --build build/fuzz --target fuzz_picture
//   build/fuzz/tests/fuzz_picture -runs=1000000 NEW_INPUTS_FOLDER tests/fuzz/picture_corpus
#include <turbojpeg.h>

#include <cstdlib>
#include <vector>

#include "firmware/ports/jpeg_decoder.h"

namespace {

using namespace finsight;

constexpr int kWidth = 40, kHeight = 24;

std::vector<std::uint8_t> good_picture() {
  const std::vector<std::uint8_t> grey(kWidth * kHeight, 99);
  const tjhandle handle = tjInitCompress();
  unsigned char* bytes = nullptr;
  unsigned long size = 0;
  if (tjCompress2(handle, grey.data(), kWidth, 0, kHeight, TJPF_GRAY, &bytes, &size, TJSAMP_GRAY, 90, 0) != 0) abort();
  std::vector<std::uint8_t> jpeg(bytes, bytes + size);
  tjFree(bytes);
  tjDestroy(handle);
  return jpeg;
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* bytes, std::size_t size) {
  static const std::vector<std::uint8_t> good = good_picture();
  static JpegDecoder decoder;
  // Of exactly this size, for the address sanitizer. What a decoder does not write differs between the two.
  std::vector<std::uint8_t> grey(kWidth * kHeight, 0), again(kWidth * kHeight, 255);
  const JpegOutcome outcome = decoder.decode({bytes, size}, kWidth, kHeight, grey.data());
  if (decoder.decode({bytes, size}, kWidth, kHeight, again.data()) != outcome) abort();
  if (outcome == JpegOutcome::kDecoded && grey != again) abort();
  if (decoder.decode(good, kWidth, kHeight, grey.data()) != JpegOutcome::kDecoded) abort();
  if (grey.front() != 99 || grey.back() != 99) abort();
  return 0;
}
