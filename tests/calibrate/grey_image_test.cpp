#include "hostgen/calibrate/grey_image.h"

#include <doctest/doctest.h>

#include "firmware/input_error.h"
#include "tests/model/scratch_folder.h"
#include "tests/random.h"

using namespace finsight;
using namespace finsight::host;

namespace {

template <class Read>
std::string refusal(const Read& read, const std::filesystem::path& file) {
  try {
    read(file);
  } catch (const InputError& error) {
    return error.what();
  }
  return "accepted";
}

bool says(const std::string& text, const char* part) { return text.find(part) != std::string::npos; }

}  // namespace

TEST_CASE("grey image: a PNG file comes back as it was written") {
  const test::ScratchFolder folder;
  GreyImage image{5, 3, {}};
  for (int i = 0; i < 15; ++i) image.grey.push_back(static_cast<std::uint8_t>(17 * i));
  const GreyImage again = read_png(folder.write("a.png", png_bytes(image, 11811)));
  CHECK(again.width_px == 5);
  CHECK(again.height_px == 3);
  CHECK(again.grey == image.grey);
}

TEST_CASE("grey image: a colour PNG file has its size and its colours") {
  const test::ScratchFolder folder;
  const std::vector<std::uint8_t> rgb = {255, 255, 255, 0, 0, 0, 255, 0, 0, 0, 255, 0};
  const GreyImage image = read_png(folder.write("a.png", colour_png_bytes(2, 2, rgb)));
  REQUIRE(image.width_px == 2);
  REQUIRE(image.height_px == 2);
  CHECK(image.grey[0] == 255);
  CHECK(image.grey[1] == 0);
  CHECK(image.grey[3] > image.grey[2]);  // green is brighter than red
}

TEST_CASE("grey image: a PGM file is read, with comments and any spaces in its header") {
  const test::ScratchFolder folder;
  const GreyImage image = read_pgm(folder.write("a.pgm", "P5\n# a comment\n 3\t2 # another\n255\nabcdef"));
  CHECK(image.width_px == 3);
  CHECK(image.height_px == 2);
  CHECK(std::string(image.grey.begin(), image.grey.end()) == "abcdef");
}

TEST_CASE("grey image: what is no image is refused with what is wrong") {
  const test::ScratchFolder folder;
  const auto pgm = [&](const std::string& bytes) { return refusal(read_pgm, folder.write("a.pgm", bytes)); };
  CHECK(says(pgm(""), "a.pgm: no binary PGM"));
  CHECK(says(pgm("P2\n1 1\n255\n7"), "no binary PGM"));
  CHECK(says(pgm("P5\n3 2\n255\nabcde"), "pixels: found 5 bytes, expected 6"));
  CHECK(says(pgm("P5\n3 2\n65535\nabcdefabcdef"), "largest grey level: found 65535, expected 255"));
  CHECK(says(pgm("P5\n0 2\n255\n"), "size: found 0 x 2"));
  CHECK(says(pgm("P5\n-3 2\n255\nabcdef"), "size: found -3 x 2"));
  CHECK(says(pgm("P5\n99999999999999999999 2\n255\n"), "header"));
  CHECK(says(pgm("P5\n4000000000 4000000000\n255\n"), "size"));
  CHECK(says(pgm("P5\n# no end"), "header"));
  CHECK(says(pgm("P5\n3"), "header"));

  const auto png = [&](const std::string& bytes) { return refusal(read_png, folder.write("a.png", bytes)); };
  GreyImage image{40, 30, std::vector<std::uint8_t>(1200, 7)};
  for (std::size_t i = 0; i < image.grey.size(); ++i) image.grey[i] = static_cast<std::uint8_t>(i * i);
  const std::string good = png_bytes(image, 1000);
  CHECK(png(good) == "accepted");
  CHECK(says(png(""), "a.png: no PNG image"));
  CHECK(says(png("hello"), "no PNG image"));
  CHECK(says(png(good.substr(0, good.size() / 2)), "no PNG image"));
  CHECK(says(refusal(read_png, folder / "none.png"), "none.png: cannot be opened"));
  CHECK(says(refusal(read_png, folder.path()), "is a folder"));
}

TEST_CASE("grey image: files with wrong bytes are read or refused, nothing else") {
  const test::ScratchFolder folder;
  const std::string png = png_bytes({40, 30, std::vector<std::uint8_t>(1200, 7)}, 1000), pgm = "P5\n3 2\n255\nabcdef";
  test::Random random(3);
  int refused = 0;
  for (int i = 0; i < 300; ++i) {
    const bool is_png = i % 2 == 0;
    std::string bytes = is_png ? png : pgm;
    for (int wrong = 0; wrong < 3; ++wrong) {
      bytes[static_cast<std::size_t>(random.uniform() * static_cast<double>(bytes.size()))] =
          static_cast<char>(static_cast<int>(256 * random.uniform()));
    }
    refused += refusal(is_png ? read_png : read_pgm, folder.write("a", bytes)) != "accepted";
  }
  CHECK(refused > 50);
}
