#include "firmware/ports/jpeg_decoder.h"

#include <doctest/doctest.h>
#include <turbojpeg.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>
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
                 int height = kHeight, int first_row = 0) {
  Bytes pixels = picture();
  if (subsampling != TJSAMP_GRAY) {
    Bytes rgb;
    for (const std::uint8_t grey : pixels) rgb.insert(rgb.end(), 3, grey);
    pixels = rgb;
  }
  const int pixel_bytes = subsampling == TJSAMP_GRAY ? 1 : 3;
  const std::uint8_t* first = pixels.data() + static_cast<std::ptrdiff_t>(first_row) * width * pixel_bytes;
  const tjhandle handle = tjInitCompress();
  unsigned char* bytes = nullptr;
  unsigned long size = 0;
  REQUIRE(tjCompress2(handle, first, width, 0, height, subsampling == TJSAMP_GRAY ? TJPF_GRAY : TJPF_RGB, &bytes, &size,
                      subsampling, quality, flags) == 0);
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

/// The same pixels with a restart marker after each row of blocks. The data between two markers do not depend on those
/// before, so they are the data of a picture of these rows alone.
Bytes with_restarts(int subsampling = TJSAMP_GRAY) {
  const int rows = subsampling == TJSAMP_420 ? 16 : 8;
  const int blocks = kWidth / (subsampling == TJSAMP_420 || subsampling == TJSAMP_422 ? 16 : 8);
  Bytes jpeg = compressed(subsampling);
  jpeg.resize(data_of(jpeg));
  insert(jpeg, find(jpeg, 0xDA), {0xFF, 0xDD, 0, 4, 0, static_cast<std::uint8_t>(blocks)});
  for (int row = 0; row < kHeight; row += rows) {
    if (row > 0) insert(jpeg, jpeg.size(), {0xFF, static_cast<std::uint8_t>(0xD0 + (row / rows - 1) % 8)});
    const Bytes strip = compressed(subsampling, 90, 0, kWidth, rows, row);
    jpeg.insert(jpeg.end(), strip.begin() + static_cast<std::ptrdiff_t>(data_of(strip)), strip.end() - 2);
  }
  insert(jpeg, jpeg.size(), {0xFF, 0xD9});
  return jpeg;
}

std::vector<std::size_t> restarts_of(const Bytes& jpeg) {
  std::vector<std::size_t> found;
  for (std::size_t at = data_of(jpeg); at + 1 < jpeg.size(); ++at) {
    if (jpeg[at] == 0xFF && jpeg[at + 1] >= 0xD0 && jpeg[at + 1] <= 0xD7) found.push_back(at);
  }
  return found;
}

/// Fewer and more than the eight bytes that libjpeg reads ahead.
constexpr std::size_t kPaddings[] = {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 15, 16, 17, 64, 500};

/// Decodes into memory with guards on either side, twice: what the decoder does not write differs.
JpegOutcome decode(const Bytes& jpeg, Bytes* grey = nullptr) {
  static JpegDecoder decoder;  // one for all: a broken picture must not spoil the next one
  JpegOutcome outcomes[2] = {};
  Bytes greys[2];
  for (int turn = 0; turn < 2; ++turn) {
    const std::uint8_t before = turn == 0 ? 77 : 178;
    Bytes memory(kWidth * kHeight + 128, before);
    outcomes[turn] = decoder.decode(jpeg, kWidth, kHeight, memory.data() + 64);
    CHECK(std::all_of(memory.begin(), memory.begin() + 64, [&](int byte) { return byte == before; }));
    CHECK(std::all_of(memory.end() - 64, memory.end(), [&](int byte) { return byte == before; }));
    greys[turn] = Bytes(memory.begin() + 64, memory.end() - 64);
  }
  CHECK(outcomes[0] == outcomes[1]);
  if (outcomes[0] == JpegOutcome::kDecoded) CHECK(greys[0] == greys[1]);
  if (grey) *grey = greys[0];
  return outcomes[0];
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

TEST_CASE("jpeg decoder: a picture with restart markers is decoded, also with zeros or 0xFF before its end marker") {
  for (const int subsampling : {TJSAMP_GRAY, TJSAMP_422, TJSAMP_420}) {
    Bytes expected;
    REQUIRE(decode(compressed(subsampling), &expected) == JpegOutcome::kDecoded);
    const Bytes good = with_restarts(subsampling);
    REQUIRE(restarts_of(good).size() == (subsampling == TJSAMP_420 ? 6 : 13));
    for (const std::uint8_t fill : Bytes{0, 0xFF}) {
      for (const std::size_t padding : kPaddings) {
        CAPTURE(subsampling);
        CAPTURE(int{fill});
        CAPTURE(padding);
        Bytes jpeg = good;
        insert(jpeg, jpeg.size() - 2, Bytes(padding, fill));
        Bytes grey;
        REQUIRE(decode(jpeg, &grey) == JpegOutcome::kDecoded);
        CHECK(grey == expected);
      }
    }
  }
}

TEST_CASE("jpeg decoder: a picture that ends at a restart marker is broken, whatever comes before its end marker") {
  for (const int subsampling : {TJSAMP_GRAY, TJSAMP_422, TJSAMP_420}) {
    const Bytes good = with_restarts(subsampling);
    for (const std::size_t restart : restarts_of(good)) {
      for (const std::size_t kept : {restart, restart + 2}) {  // without the marker and with it
        for (const std::uint8_t fill : Bytes{0, 0xFF, 0x12}) {
          for (const std::size_t padding : kPaddings) {
            CAPTURE(subsampling);
            CAPTURE(kept);
            CAPTURE(int{fill});
            CAPTURE(padding);
            Bytes jpeg(good.begin(), good.begin() + static_cast<std::ptrdiff_t>(kept));
            insert(jpeg, kept, Bytes(padding, fill));
            insert(jpeg, jpeg.size(), {0xFF, 0xD9});
            CHECK(decode(jpeg) == JpegOutcome::kBroken);
          }
        }
      }
    }
    CHECK(decode(good) == JpegOutcome::kDecoded);
  }
}

TEST_CASE("jpeg decoder: zeros before the end marker do no harm to data that end with zeros themselves") {
  int ends_with_zero = 0;
  for (int quality = 1; quality <= 100; ++quality) {
    const Bytes good = compressed(TJSAMP_422, quality);  // without colours, whose blocks are zero bits
    if (good[good.size() - 3] == 0) ++ends_with_zero;
    Bytes expected;
    REQUIRE(decode(good, &expected) == JpegOutcome::kDecoded);
    for (const std::size_t padding : kPaddings) {
      CAPTURE(quality);
      CAPTURE(padding);
      Bytes jpeg = good;
      insert(jpeg, jpeg.size() - 2, Bytes(padding, 0));
      Bytes grey;
      REQUIRE(decode(jpeg, &grey) == JpegOutcome::kDecoded);
      CHECK(grey == expected);
    }
  }
  CHECK(ends_with_zero > 0);
}

TEST_CASE("jpeg decoder: zeros in place of the last data are told, although they decode") {
  for (const Bytes& good : {compressed(), compressed(TJSAMP_422), compressed(TJSAMP_420), with_restarts()}) {
    const std::size_t data = data_of(good);
    for (std::size_t kept = data; kept + 20 < good.size(); kept += 37) {
      for (const std::size_t padding : std::vector<std::size_t>{20, 500, 5000, 20000}) {
        CAPTURE(kept);
        CAPTURE(padding);
        Bytes jpeg(good.begin(), good.begin() + static_cast<std::ptrdiff_t>(kept));
        insert(jpeg, kept, Bytes(padding, 0));
        insert(jpeg, jpeg.size(), {0xFF, 0xD9});
        CHECK(decode(jpeg) == JpegOutcome::kBroken);
      }
    }
  }
}

TEST_CASE("jpeg decoder: bytes left over that are neither zero nor 0xFF make a picture broken") {
  const Bytes other(16, 0x12), zeros(40, 0);
  for (const Bytes& good : {compressed(TJSAMP_422), with_restarts()}) {
    for (const auto& left_over : {std::pair{other, Bytes()}, {other, zeros}, {zeros, {0x12}}}) {
      CAPTURE(left_over.first.size());
      CAPTURE(left_over.second.size());
      Bytes jpeg = good;
      insert(jpeg, jpeg.size() - 2, left_over.first);
      insert(jpeg, jpeg.size() - 2, left_over.second);
      CHECK(decode(jpeg) == JpegOutcome::kBroken);
    }
  }
}

TEST_CASE("jpeg decoder: data that come twice are told by what is left over, also before zeros") {
  const Bytes good = compressed(TJSAMP_422);
  const std::size_t data = data_of(good);
  for (const std::size_t padding : std::vector<std::size_t>{0, 100}) {
    for (std::size_t at = data + 50; at + 250 < good.size(); at += 50) {
      CAPTURE(padding);
      CAPTURE(at);
      Bytes jpeg = good;
      insert(jpeg, jpeg.size() - 2, Bytes(padding, 0));
      insert(
          jpeg, at,
          Bytes(good.begin() + static_cast<std::ptrdiff_t>(at), good.begin() + static_cast<std::ptrdiff_t>(at + 200)));
      CHECK(decode(jpeg) == JpegOutcome::kBroken);
    }
  }
}
