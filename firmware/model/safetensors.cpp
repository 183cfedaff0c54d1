#include "firmware/model/safetensors.h"

#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <bit>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <limits>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>

#include "firmware/input_error.h"

namespace finsight {

static_assert(std::endian::native == std::endian::little, "tensors are used in place");

namespace {

using nlohmann::json;

constexpr std::size_t kLengthBytes = 8;                     // the header's length, little-endian
constexpr std::size_t kHeaderLimit = std::size_t{1} << 20;  // some hundred tensors; safetensors allows 100 MB
constexpr std::size_t kNameLimit = 128, kRankLimit = 8;     // keep messages on one line
constexpr int kDepthLimit = 4;                              // header, tensor, its shape; one to spare
constexpr const char* kMetadata = "__metadata__";

struct TypeEntry {
  DType type;
  const char* name;
  std::size_t size;
};
constexpr TypeEntry kTypes[] = {{DType::kF32, "F32", 4}, {DType::kF64, "F64", 8}, {DType::kI8, "I8", 1},
                                {DType::kU8, "U8", 1},   {DType::kU16, "U16", 2}, {DType::kI32, "I32", 4},
                                {DType::kI64, "I64", 8}};

const TypeEntry& type_entry(DType type) { return kTypes[static_cast<int>(type)]; }

std::optional<DType> dtype_named(const std::string& name) {
  for (const TypeEntry& entry : kTypes) {
    if (name == entry.name) return entry.type;
  }
  return std::nullopt;
}

struct Tensor {
  DType type = DType::kF32;
  std::vector<std::int64_t> shape;
  std::size_t begin = 0, end = 0;  // bytes, counted from the end of the header
};

/// A file's bytes, mapped for reading for as long as this lives.
struct Mapping {
  const std::byte* data = nullptr;
  std::size_t size = 0;

  Mapping() = default;
  Mapping(const Mapping&) = delete;
  Mapping& operator=(const Mapping&) = delete;
  ~Mapping() {
    if (data) munmap(const_cast<std::byte*>(data), size);
  }

  void map(const std::string& path, std::size_t size_limit) {
    // O_NONBLOCK: a named pipe given by mistake must not hang the start.
    const int fd = open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK);
    if (fd < 0) throw InputError(path, std::string("cannot be opened: ") + std::strerror(errno));
    struct stat status {};
    const bool regular = fstat(fd, &status) == 0 && S_ISREG(status.st_mode);
    size = regular ? static_cast<std::size_t>(status.st_size) : 0;
    const bool fits = size > kLengthBytes && size <= size_limit;
    void* address = fits ? mmap(nullptr, size, PROT_READ, MAP_PRIVATE, fd, 0) : MAP_FAILED;
    close(fd);
    if (!regular) throw InputError(path, "is not a regular file");
    if (!fits) {
      throw InputError(path, "size", std::to_string(size) + " bytes",
                       std::to_string(kLengthBytes + 1) + " to " + std::to_string(size_limit) + " bytes");
    }
    if (address == MAP_FAILED) throw InputError(path, "cannot be mapped into memory");
    data = static_cast<const std::byte*>(address);
  }
};

std::string shape_text(std::span<const std::int64_t> shape) {
  std::string text = "[";
  for (const std::int64_t length : shape) {
    text += (text.size() > 1 ? ", " : "") + (length < 0 ? std::string("any") : std::to_string(length));
  }
  return text + "]";
}

/// A JSON value for a message: on one line, printable, short.
std::string shown(const json& value) {
  std::string text = value.dump(-1, ' ', true, json::error_handler_t::replace);
  if (text.size() > 60) text = text.substr(0, 57) + "...";
  return text;
}

bool is_plain_name(const std::string& name) {
  const auto printable = [](char c) { return c > ' ' && c <= '~' && c != '\'' && c != '"' && c != '\\'; };
  return !name.empty() && name.size() <= kNameLimit && std::all_of(name.begin(), name.end(), printable);
}

/// Parses the header's text. The JSON library keeps the last of two equal keys and others may keep the first, so
/// equal keys are refused here, while parsing.
json parse_header(const std::string& path, std::string_view text) {
  std::vector<std::set<std::string>> open_objects;
  std::string duplicate;
  bool too_deep = false;
  const auto watch = [&](int depth, json::parse_event_t event, json& parsed) {
    too_deep |= depth > kDepthLimit;
    if (event == json::parse_event_t::object_start) open_objects.emplace_back();
    if (event == json::parse_event_t::object_end) open_objects.pop_back();
    if (event == json::parse_event_t::key && !open_objects.back().insert(parsed.get<std::string>()).second) {
      duplicate = shown(parsed);
    }
    return true;
  };
  json header = json::parse(text, watch, false);
  if (header.is_discarded() || !header.is_object()) {
    throw InputError(path, "header", "text that is not a JSON object", "a safetensors header");
  }
  if (too_deep) throw InputError(path, "header", "deeply nested JSON", "a safetensors header");
  if (!duplicate.empty()) throw InputError(path, "header", "the key " + duplicate + " twice", "each key once");
  return header;
}

std::vector<std::int64_t> read_shape(const json& value, const auto& refuse) {
  constexpr const char* kExpected = "\"shape\" to be at most 8 non-negative integers";
  if (!value.is_array() || value.size() > kRankLimit) refuse(shown(value), kExpected);
  std::vector<std::int64_t> shape;
  for (const json& length : value) {
    constexpr auto kMax = static_cast<std::uint64_t>(std::numeric_limits<std::int64_t>::max());
    if (!length.is_number_unsigned() || length.get<std::uint64_t>() > kMax) refuse(shown(value), kExpected);
    shape.push_back(length.get<std::int64_t>());
  }
  return shape;
}

/// Bytes of a tensor, or nothing if the product does not fit a size_t.
std::optional<std::size_t> byte_count(const Tensor& tensor) {
  std::size_t bytes = dtype_size(tensor.type);
  for (const std::int64_t length : tensor.shape) {
    if (__builtin_mul_overflow(bytes, static_cast<std::size_t>(length), &bytes)) return std::nullopt;
  }
  return bytes;
}

/// `entry`: {"dtype": "F32", "shape": [..], "data_offsets": [begin, end]} and nothing else; `data_size` bytes exist.
Tensor read_entry(const json& entry, std::size_t data_size, const auto& refuse) {
  if (!entry.is_object() || entry.size() != 3 || !entry.contains("dtype") || !entry.contains("shape") ||
      !entry.contains("data_offsets")) {
    refuse(shown(entry), "exactly \"dtype\", \"shape\" and \"data_offsets\"");
  }
  Tensor tensor;
  const json& name = entry["dtype"];
  const auto type = name.is_string() ? dtype_named(name.get<std::string>()) : std::nullopt;
  if (!type) refuse("\"dtype\" " + shown(name), "F32, F64, I8, U8, U16, I32 or I64");
  tensor.type = *type;
  tensor.shape = read_shape(entry["shape"], refuse);

  const json& offsets = entry["data_offsets"];
  const auto is_offset = [](const json& value) { return value.is_number_unsigned(); };
  if (!offsets.is_array() || offsets.size() != 2 || !std::all_of(offsets.begin(), offsets.end(), is_offset)) {
    refuse("\"data_offsets\" " + shown(offsets), "two non-negative integers");
  }
  const auto begin = offsets[0].get<std::uint64_t>(), end = offsets[1].get<std::uint64_t>();
  if (begin > end || end > data_size) {
    refuse("\"data_offsets\" " + shown(offsets), "offsets within the " + std::to_string(data_size) + " bytes of data");
  }
  tensor.begin = begin;
  tensor.end = end;
  const auto bytes = byte_count(tensor);
  if (!bytes || *bytes != end - begin) {
    refuse(std::to_string(end - begin) + " bytes",
           (bytes ? std::to_string(*bytes) : std::string("too many")) + " bytes for shape " + shape_text(tensor.shape));
  }
  return tensor;
}

template <class T>
std::optional<std::size_t> first_not_finite(std::span<const std::byte> bytes) {
  const std::span values(reinterpret_cast<const T*>(bytes.data()), bytes.size() / sizeof(T));
  const auto found = std::find_if(values.begin(), values.end(), [](T value) { return !std::isfinite(value); });
  if (found == values.end()) return std::nullopt;
  return static_cast<std::size_t>(found - values.begin());
}

}  // namespace

const char* dtype_name(DType type) { return type_entry(type).name; }
std::size_t dtype_size(DType type) { return type_entry(type).size; }

struct SafetensorsFile::Contents {
  std::string path;
  Mapping file;
  std::span<const std::byte> data;  // what follows the header
  std::map<std::string, Tensor> tensors;
  std::vector<std::string> order;  // names in file order
  std::map<std::string, std::string> metadata;

  [[noreturn]] void refuse(const std::string& name, const std::string& found, const std::string& expected) const {
    throw InputError(path, "tensor '" + name + "'", found, expected);
  }
  const Tensor& find(const std::string& name) const {
    const auto found = tensors.find(name);
    if (found == tensors.end()) refuse(name, "nothing", "a tensor of this name");
    return found->second;
  }
  void read_header();
  void read_metadata(const json& header);
  void check_tiling();
};

void SafetensorsFile::Contents::read_header() {
  std::uint64_t length = 0;
  std::memcpy(&length, file.data, kLengthBytes);
  const std::size_t most = std::min(kHeaderLimit, file.size - kLengthBytes);
  if (length < 2 || length > most) {
    throw InputError(path, "header length", std::to_string(length), "2 to " + std::to_string(most) + " bytes");
  }
  const std::size_t data_start = kLengthBytes + length;
  data = {file.data + data_start, file.size - data_start};
  const json header = parse_header(path, {reinterpret_cast<const char*>(file.data) + kLengthBytes, length});
  read_metadata(header);
  for (const auto& item : header.items()) {
    const std::string& name = item.key();
    if (name == kMetadata) continue;
    if (!is_plain_name(name)) throw InputError(path, "tensor name", shown(name), "at most 128 printable characters");
    const auto refuse_entry = [&](const std::string& found, const std::string& expected) {
      refuse(name, found, expected);
    };
    const Tensor tensor = read_entry(item.value(), data.size(), refuse_entry);
    if ((data_start + tensor.begin) % dtype_size(tensor.type) != 0) {
      refuse(name, "data at byte " + std::to_string(data_start + tensor.begin),
             "a multiple of " + std::to_string(dtype_size(tensor.type)));
    }
    tensors.emplace(name, tensor);
  }
}

void SafetensorsFile::Contents::read_metadata(const json& header) {
  const auto found = header.find(kMetadata);
  if (found == header.end()) return;
  if (!found->is_object()) throw InputError(path, kMetadata, shown(*found), "an object of strings");
  for (const auto& [key, value] : found->items()) {
    if (!value.is_string()) throw InputError(path, std::string(kMetadata) + " " + shown(key), shown(value), "a string");
    metadata.emplace(key, value.get<std::string>());
  }
}

/// In file order the tensors must cover the data without gap or overlap.
void SafetensorsFile::Contents::check_tiling() {
  for (const auto& [name, tensor] : tensors) order.push_back(name);
  std::stable_sort(order.begin(), order.end(), [&](const std::string& a, const std::string& b) {
    const Tensor &left = tensors.at(a), &right = tensors.at(b);
    return std::pair(left.begin, left.end) < std::pair(right.begin, right.end);
  });
  std::size_t at = 0;
  for (const std::string& name : order) {
    const Tensor& tensor = tensors.at(name);
    if (tensor.begin != at) {
      refuse(name, "data at offset " + std::to_string(tensor.begin),
             "offset " + std::to_string(at) + ", where the tensor before it ends");
    }
    at = tensor.end;
  }
  if (at != data.size()) {
    throw InputError(path, "data", std::to_string(data.size()) + " bytes",
                     std::to_string(at) + " bytes, all in tensors");
  }
}

SafetensorsFile SafetensorsFile::open(const std::filesystem::path& file, std::size_t size_limit) {
  auto contents = std::make_unique<Contents>();
  contents->path = file.string();
  contents->file.map(contents->path, size_limit);
  contents->read_header();
  contents->check_tiling();
  return SafetensorsFile(std::move(contents));
}

SafetensorsFile::SafetensorsFile(std::unique_ptr<Contents> contents) : contents_(std::move(contents)) {}
SafetensorsFile::SafetensorsFile(SafetensorsFile&&) noexcept = default;
SafetensorsFile& SafetensorsFile::operator=(SafetensorsFile&&) noexcept = default;
SafetensorsFile::~SafetensorsFile() = default;

bool SafetensorsFile::has(const std::string& name) const { return contents_->tensors.contains(name); }
std::vector<std::int64_t> SafetensorsFile::shape(const std::string& name) const { return contents_->find(name).shape; }
DType SafetensorsFile::dtype(const std::string& name) const { return contents_->find(name).type; }
std::vector<std::string> SafetensorsFile::names() const { return contents_->order; }
const std::map<std::string, std::string>& SafetensorsFile::all_metadata() const { return contents_->metadata; }
const std::string& SafetensorsFile::path() const { return contents_->path; }
std::span<const std::byte> SafetensorsFile::bytes() const { return {contents_->file.data, contents_->file.size}; }

const std::string& SafetensorsFile::metadata(const std::string& key) const {
  const auto found = contents_->metadata.find(key);
  if (found == contents_->metadata.end()) {
    throw InputError(path(), "metadata '" + key + "'", "nothing", "a key of this name");
  }
  return found->second;
}

std::span<const std::byte> SafetensorsFile::raw(const std::string& name) const {
  const Tensor& tensor = contents_->find(name);
  return contents_->data.subspan(tensor.begin, tensor.end - tensor.begin);
}

std::span<const std::byte> SafetensorsFile::raw(const std::string& name, DType type,
                                                std::initializer_list<std::int64_t> shape) const {
  const Tensor& tensor = contents_->find(name);
  const auto fits = [](std::int64_t expected, std::int64_t found) { return expected < 0 || expected == found; };
  if (tensor.type != type || !std::equal(shape.begin(), shape.end(), tensor.shape.begin(), tensor.shape.end(), fits)) {
    refuse(name, dtype_name(tensor.type) + std::string(" ") + shape_text(tensor.shape),
           dtype_name(type) + std::string(" ") + shape_text(shape));
  }
  const std::span<const std::byte> bytes = raw(name);
  std::optional<std::size_t> bad;
  if (type == DType::kF32) bad = first_not_finite<float>(bytes);
  if (type == DType::kF64) bad = first_not_finite<double>(bytes);
  if (bad) refuse(name, "element " + std::to_string(*bad) + " not finite", "finite numbers");
  return bytes;
}

void SafetensorsFile::refuse(const std::string& name, const std::string& found, const std::string& expected) const {
  contents_->refuse(name, found, expected);
}

}  // namespace finsight
