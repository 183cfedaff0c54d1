// libFuzzer target: no bytes make Model::open do anything but succeed or throw InputError.
//   cmake -S . -B build/fuzz -DFINSIGHT_FUZZ=ON -DCMAKE_CXX_COMPILER=clang++ && cmake --build build/fuzz --target
//   fuzz_pack build/fuzz/tests/fuzz_pack CORPUS_FOLDER     (a good seed is any pack)
#include "firmware/input_error.h"
#include "hostgen/pack/model_pack.h"
#include "tests/fuzz/memory_file.h"

namespace {

using namespace finsight;

/// The same tensors and metadata with right checksums: without this no input would get past them.
std::string resealed(const SafetensorsFile& file) {
  host::TensorFile tensors;
  tensors.metadata = file.all_metadata();
  std::erase_if(tensors.metadata, [](const auto& item) { return item.first.starts_with(meta::kTensorCrc); });
  for (const std::string& name : file.names()) {
    const auto data = file.raw(name);
    tensors.add({name, file.dtype(name), file.shape(name), {data.begin(), data.end()}});
  }
  return host::sealed_bytes(tensors);
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* bytes, std::size_t size) {
  try {
    const MemoryFile given(bytes, size);
    const std::string pack = resealed(SafetensorsFile::open(given.path()));
    const MemoryFile sealed(pack.data(), pack.size());
    host::describe_model_pack(Model::open(sealed.path()));
  } catch (const InputError&) {
  }
  return 0;
}
