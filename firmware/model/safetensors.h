// The container of the model pack: a plain safetensors file, opened strictly.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <span>
#include <string>
#include <vector>

namespace finsight {

/// Element types that a pack may hold, under their safetensors names.
enum class DType { kF32, kF64, kI8, kU8, kU16, kI32, kI64 };
const char* dtype_name(DType type);
std::size_t dtype_size(DType type);
template <class T>
constexpr DType dtype_of();
template <>
constexpr DType dtype_of<float>() {
  return DType::kF32;
}
template <>
constexpr DType dtype_of<double>() {
  return DType::kF64;
}
template <>
constexpr DType dtype_of<std::int8_t>() {
  return DType::kI8;
}
template <>
constexpr DType dtype_of<std::uint8_t>() {
  return DType::kU8;
}
template <>
constexpr DType dtype_of<std::uint16_t>() {
  return DType::kU16;
}
template <>
constexpr DType dtype_of<std::int32_t>() {
  return DType::kI32;
}
template <>
constexpr DType dtype_of<std::int64_t>() {
  return DType::kI64;
}

/// A safetensors file, mapped read-only. Header limit 1 MiB, file limit 64 MiB (512 MiB for training sets).
/// Opening checks the header's length, JSON, types, shapes and that the tensors tile the data without gap or overlap.
class SafetensorsFile {
 public:
  /// Throws InputError naming the file, the tensor, what was found and what was expected.
  static SafetensorsFile open(const std::filesystem::path& file, std::size_t size_limit = std::size_t{64} << 20);
  SafetensorsFile(SafetensorsFile&&) noexcept;
  SafetensorsFile& operator=(SafetensorsFile&&) noexcept;
  ~SafetensorsFile();

  /// A tensor of exactly this type and shape; a shape entry of -1 accepts any length. Floats are checked to be finite.
  /// Throws InputError.
  template <class T>
  std::span<const T> tensor(const std::string& name, std::initializer_list<std::int64_t> shape) const {
    const std::span<const std::byte> bytes = raw(name, dtype_of<T>(), shape);
    return {reinterpret_cast<const T*>(bytes.data()), bytes.size() / sizeof(T)};
  }
  bool has(const std::string& name) const;
  std::vector<std::int64_t> shape(const std::string& name) const;
  DType dtype(const std::string& name) const;
  std::vector<std::string> names() const;  ///< in file order
  /// Throws InputError if the key is missing.
  const std::string& metadata(const std::string& key) const;
  const std::map<std::string, std::string>& all_metadata() const;
  const std::string& path() const;
  std::span<const std::byte> bytes() const;                       ///< the whole file
  std::span<const std::byte> raw(const std::string& name) const;  ///< a tensor's bytes, unchecked values
  /// Throws InputError for a tensor: "pack.safetensors: tensor 'name': found ..., expected ...".
  [[noreturn]] void refuse(const std::string& name, const std::string& found, const std::string& expected) const;

 private:
  struct Contents;
  explicit SafetensorsFile(std::unique_ptr<Contents> contents);
  std::span<const std::byte> raw(const std::string& name, DType type, std::initializer_list<std::int64_t> shape) const;
  std::unique_ptr<Contents> contents_;
};

}  // namespace finsight
