// libFuzzer target: no bytes make a reader of sessions do anything but succeed or throw InputError. The first byte says
// what the others are: images (frames.y4m), what is known about them (session.toml), recorded motions (CSV).
//   cmake -S . -B build/fuzz -G Ninja -DFINSIGHT_FUZZ=ON -DCMAKE_CXX_COMPILER=clang++
//   cmake --build build/fuzz --target fuzz_session
//   build/fuzz/tests/fuzz_session -runs=1000000 NEW_INPUTS_FOLDER tests/fuzz/session_corpus
#include <fstream>
#include <vector>

#include "firmware/input_error.h"
#include "firmware/ports/session.h"
#include "tests/fuzz/memory_file.h"

namespace {

using namespace finsight;

void read_images(const MemoryFile& file) {
  constexpr int kMax = 20;
  Y4mReader reader(file.path());
  std::vector<std::uint8_t> grey;
  for (int n = 0; n < kMax && reader.next(grey); ++n) {
    if (grey.size() != static_cast<std::size_t>(reader.width_px()) * static_cast<std::size_t>(reader.height_px()))
      abort();
  }
  reader.rewind();
  for (int n = 0; n < kMax && reader.skip(); ++n) {
  }
}

/// It is asked for by its folder.
void read_info(const std::uint8_t* bytes, std::size_t size) {
  static const std::filesystem::path folder = [] {
    std::string name = "/dev/shm/session_fuzz_XXXXXX";
    if (!mkdtemp(name.data())) abort();
    return name;
  }();
  std::ofstream(folder / kSessionInfo, std::ios::binary)
      .write(reinterpret_cast<const char*>(bytes), static_cast<std::streamsize>(size));
  read_session_info(folder);
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* bytes, std::size_t size) {
  if (size == 0) return 0;
  try {
    const MemoryFile file(bytes + 1, size - 1);
    switch (bytes[0] % 3) {
      case 0:
        read_images(file);
        break;
      case 1:
        read_info(bytes + 1, size - 1);
        break;
      default:
        read_recorded_motion(file.path(), "");
    }
  } catch (const InputError&) {
  }
  return 0;
}
