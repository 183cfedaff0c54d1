#include "firmware/ports/jpeg_decoder.h"

#include <doctest/doctest.h>
#include <turbojpeg.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

using namespace finsight;

namespace {

constexpr int kWidth = 160, kHeight = 112;
using Bytes = std::vector<std::uint8_t>;

/// A smooth picture in which every row and column differs.
Bytes picture() {
  Bytes grey(kWidth * kHeight);
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x) {
      grey[static_cast<std::size_t>(y * kWidth + x)] =
          static_cast<std::uint8_t>(128 + 60 * std::sin(x / 11.0) + 50 * std::cos(y / 7.0));
    }
  }
  return grey;
}

Bytes compressed(int subsampling = TJSAMP_GRAY, int quality = 90, int flags = 0, int width = kWidth,
                 int height = kHeight) {
  Bytes pixels = picture();
  if (subsampling != TJSAMP_GRAY) {
    Bytes rgb;
    for (const std::uint8_t grey : pixels) rgb.insert(rgb.end(), 3, grey);
    pixels = rgb;
  }
  const tjhandle handle = tjInitCompress();
  unsigned char* bytes = nullptr;
  unsigned long size = 0;
  REQUIRE(tjCompress2(handle, pixels.data(), width, 0, height, subsampling == TJSAMP_GRAY ? TJPF_GRAY : TJPF_RGB,
                      &bytes, &size, subsampling, quality, flags) == 0);
  Bytes jpeg(bytes, bytes + size);
  tjFree(bytes);
  tjDestroy(handle);
  return jpeg;
}

std::size_t find(const Bytes& jpeg, std::uint8_t marker, std::size_t from = 0) {
  const Bytes wanted = {0xFF, marker};
  const auto at =
      std::search(jpeg.begin() + static_cast<std::ptrdiff_t>(from), jpeg.end(), wanted.begin(), wanted.end());
  REQUIRE(at != jpeg.end());
  return static_cast<std::size_t>(at - jpeg.begin());
}

void insert(Bytes& jpeg, std::size_t at, const Bytes& extra) {
  jpeg.insert(jpeg.begin() + static_cast<std::ptrdiff_t>(at), extra.begin(), extra.end());
}

void erase(Bytes& jpeg, std::size_t from, std::size_t to) {
  jpeg.erase(jpeg.begin() + static_cast<std::ptrdiff_t>(from), jpeg.begin() + static_cast<std::ptrdiff_t>(to));
}

/// Where the data of the only scan begins.
std::size_t data_of(const Bytes& jpeg) {
  const std::size_t scan = find(jpeg, 0xDA);
  return scan + 2 + static_cast<std::size_t>(jpeg[scan + 2] << 8 | jpeg[scan + 3]);
}

/// Decodes into memory with guards on either side.
JpegOutcome decode(const Bytes& jpeg, Bytes* grey = nullptr) {
  static JpegDecoder decoder;  // one for all: a broken picture must not spoil the next one
  Bytes memory(kWidth * kHeight + 128, 77);
  const JpegOutcome outcome = decoder.decode(jpeg, kWidth, kHeight, memory.data() + 64);
  CHECK(std::all_of(memory.begin(), memory.begin() + 64, [](int byte) { return byte == 77; }));
  CHECK(std::all_of(memory.end() - 64, memory.end(), [](int byte) { return byte == 77; }));
  if (grey) *grey = Bytes(memory.begin() + 64, memory.end() - 64);
  return outcome;
}

double mean_difference(const Bytes& a, const Bytes& b) {
  double sum = 0;
  for (std::size_t i = 0; i < a.size(); ++i) sum += std::abs(int{a[i]} - int{b[i]});
  return sum / static_cast<double>(a.size());
}

}  // namespace

TEST_CASE("jpeg decoder: grey and coloured pictures of every usual subsampling give their grey levels") {
  for (const int subsampling : {TJSAMP_GRAY, TJSAMP_444, TJSAMP_422, TJSAMP_420, TJSAMP_440}) {
    CAPTURE(subsampling);
    Bytes grey;
    REQUIRE(decode(compressed(subsampling, 95), &grey) == JpegOutcome::kDecoded);
    CHECK(mean_difference(grey, picture()) < 1);
  }
}

TEST_CASE("jpeg decoder: a camera's pictures without Huffman tables use those of the standard") {
  Bytes jpeg = compressed(TJSAMP_422);
  for (int table = 0; table < 4; ++table) {
    const std::size_t at = find(jpeg, 0xC4);
    erase(jpeg, at, at + 2 + static_cast<std::size_t>(jpeg[at + 2] << 8 | jpeg[at + 3]));
  }
  Bytes grey;
  REQUIRE(decode(jpeg, &grey) == JpegOutcome::kDecoded);
  CHECK(mean_difference(grey, picture()) < 2);
}

TEST_CASE("jpeg decoder: broken pictures are told, and the next good one is decoded") {
  struct Case {
    std::string name;
    JpegOutcome outcome;
    Bytes jpeg;
  };
  const Bytes good = compressed(TJSAMP_422);
  std::vector<Case> cases = {
      {"nothing", JpegOutcome::kNotAPicture, {}},
      {"zeros", JpegOutcome::kNotAPicture, Bytes(good.size(), 0)},
      {"the start marker alone", JpegOutcome::kNotAPicture, {0xFF, 0xD8}},
      {"start and end", JpegOutcome::kBroken, {0xFF, 0xD8, 0xFF, 0xD9, 0, 0, 0, 0}},
      {"another size", JpegOutcome::kOtherSize, compressed(TJSAMP_422, 90, 0, kWidth, kHeight - 16)},
      {"width and height exchanged", JpegOutcome::kOtherSize, compressed(TJSAMP_GRAY, 90, 0, kHeight, kWidth)},
      {"progressive", JpegOutcome::kOtherKind, compressed(TJSAMP_420, 90, TJFLAG_PROGRESSIVE)},
  };
  const auto add = [&](const std::string& name, JpegOutcome outcome, const auto& change) {
    cases.push_back({name, outcome, good});
    change(cases.back().jpeg);
  };
  for (const double share : {0.02, 0.3, 0.9}) {
    add("cut off", JpegOutcome::kBroken,
        [&](Bytes& jpeg) { jpeg.resize(static_cast<std::size_t>(share * static_cast<double>(jpeg.size()))); });
  }
  add("end marker missing", JpegOutcome::kBroken, [](Bytes& jpeg) { jpeg.resize(jpeg.size() - 2); });
  add("rest zero", JpegOutcome::kBroken, [](Bytes& jpeg) {
    std::fill(jpeg.begin() + static_cast<std::ptrdiff_t>(data_of(jpeg) + 200), jpeg.end(), std::uint8_t{0});
  });
  add("bytes before the first marker", JpegOutcome::kBroken, [](Bytes& jpeg) { insert(jpeg, 2, {1, 2, 3}); });
  add("bytes between the tables", JpegOutcome::kBroken, [](Bytes& jpeg) {
    insert(jpeg, find(jpeg, 0xC4), {0x12, 0x34, 0x56, 0x78});
  });
  add("a marker amid the data", JpegOutcome::kBroken, [](Bytes& jpeg) {
    insert(jpeg, data_of(jpeg) + 300, {0xFF, 0xC4});
  });
  add("the end amid the data", JpegOutcome::kBroken, [](Bytes& jpeg) {
    insert(jpeg, data_of(jpeg) + 300, {0xFF, 0xD9});
  });
  add("two starts", JpegOutcome::kBroken, [](Bytes& jpeg) { insert(jpeg, 2, {0xFF, 0xD8}); });
  add("a segment longer than the file", JpegOutcome::kBroken, [](Bytes& jpeg) { jpeg[4] = 0xFF; });
  add("12 bits", JpegOutcome::kOtherKind, [](Bytes& jpeg) { jpeg[find(jpeg, 0xC0) + 4] = 12; });
  add("one of three parts in the scan", JpegOutcome::kOtherKind, [](Bytes& jpeg) { jpeg[find(jpeg, 0xDA) + 4] = 1; });
  for (const Case& broken : cases) {
    CAPTURE(broken.name);
    CHECK(decode(broken.jpeg) == broken.outcome);
    CHECK(decode(good) == JpegOutcome::kDecoded);
  }
}

TEST_CASE("jpeg decoder: bytes that fill up a buffer do no harm, before the end marker or behind it") {
  Bytes jpeg = compressed(TJSAMP_422);
  insert(jpeg, jpeg.size() - 2, {0, 0, 0, 0, 0});
  jpeg.resize(jpeg.size() + 1000, 0);
  Bytes grey;
  REQUIRE(decode(jpeg, &grey) == JpegOutcome::kDecoded);
  CHECK(mean_difference(grey, picture()) < 2);
}
