// Packs with a fault but with correct checksums, so that only the check under test can refuse them.
#pragma once

#include <doctest/doctest.h>

#include <functional>

#include "firmware/input_error.h"
#include "tests/model/scratch_folder.h"
#include "tests/model/tiny_model.h"

namespace finsight::test {

/// What Model::open says to a file of these bytes; "accepted" if nothing.
inline doctest::String refusal(const ScratchFolder& folder, const std::string& bytes) {
  try {
    Model::open(folder.write("pack", bytes));
  } catch (const InputError& error) {
    return error.what();
  }
  return "accepted";
}

/// A fault in a tiny model, and part of the message that must name it.
struct HostileModel {
  const char* what;
  std::function<void(TinyModel&)> spoil;
  const char* reason;
};

inline void check_refused(std::span<const HostileModel> models) {
  const ScratchFolder folder;
  for (const HostileModel& hostile : models) {
    CAPTURE(hostile.what);
    TinyModel tiny;
    hostile.spoil(tiny);
    CHECK(refusal(folder, host::sealed_bytes(host::pack_tensors(tiny.views()))) == doctest::Contains(hostile.reason));
  }
}

}  // namespace finsight::test
