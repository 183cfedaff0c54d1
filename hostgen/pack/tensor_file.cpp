#include "hostgen/pack/tensor_file.h"

#include <algorithm>
#include <cassert>
#include <nlohmann/json.hpp>

#include "hostgen/util/common.h"

namespace finsight::host {

void TensorFile::add(Entry entry) {
  std::size_t bytes = dtype_size(entry.type);
  for (const std::int64_t length : entry.shape) bytes *= static_cast<std::size_t>(length);
  assert(bytes == entry.data.size());
  const auto same_name = [&](const Entry& other) { return other.name == entry.name; };
  assert(std::none_of(entries_.begin(), entries_.end(), same_name));
  entries_.push_back(std::move(entry));
}

std::string TensorFile::bytes() const {
  std::vector<const Entry*> in_file_order;
  for (const Entry& entry : entries_) in_file_order.push_back(&entry);
  std::stable_sort(in_file_order.begin(), in_file_order.end(),
                   [](const Entry* a, const Entry* b) { return dtype_size(a->type) > dtype_size(b->type); });

  nlohmann::ordered_json header;
  if (!metadata.empty()) header["__metadata__"] = metadata;
  std::string data;
  for (const Entry* entry : in_file_order) {
    const std::size_t begin = data.size();
    data.append(reinterpret_cast<const char*>(entry->data.data()), entry->data.size());
    header[entry->name] = {
        {"dtype", dtype_name(entry->type)}, {"shape", entry->shape}, {"data_offsets", {begin, data.size()}}};
  }
  std::string text = header.dump();
  text.resize((text.size() + 7) / 8 * 8, ' ');

  std::uint64_t length = text.size();
  std::string file(sizeof length, '\0');
  std::memcpy(file.data(), &length, sizeof length);
  return file + text + data;
}

void TensorFile::write(const std::filesystem::path& file) const { write_file_atomically(file, bytes()); }

}  // namespace finsight::host
