// Writes safetensors files (the model pack, training sets): same tensors, same bytes.
#pragma once

#include <cstring>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "firmware/model/safetensors.h"

namespace finsight::host {

/// Tensors with their metadata.
class TensorFile {
 public:
  struct Entry {
    std::string name;
    DType type;
    std::vector<std::int64_t> shape;
    std::vector<std::byte> data;
  };

  std::map<std::string, std::string> metadata;

  /// `values` is copied; its length must be the product of `shape` (asserted), `name` a new one (asserted).
  template <class T>
  void add(const std::string& name, std::vector<std::int64_t> shape, std::span<const T> values) {
    const auto data = std::as_bytes(values);
    add(Entry{name, dtype_of<T>(), std::move(shape), {data.begin(), data.end()}});
  }
  template <class T>
  void add(const std::string& name, std::vector<std::int64_t> shape, const std::vector<T>& values) {
    add(name, std::move(shape), std::span<const T>(values));
  }
  void add(Entry entry);
  /// 8-byte header length, JSON header padded to 8 bytes, then the tensors. Safetensors allows no gap, so they are
  /// ordered by falling element size (stable otherwise): each is then aligned to its own element.
  std::string bytes() const;
  void write(const std::filesystem::path& file) const;            ///< atomically
  const std::vector<Entry>& entries() const { return entries_; }  ///< in the order of add()

 private:
  std::vector<Entry> entries_;
};

}  // namespace finsight::host
