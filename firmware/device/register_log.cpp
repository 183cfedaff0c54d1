#include "firmware/device/register_log.h"

#include <string>
#include <utility>

#include "firmware/settings/atomic_file.h"

namespace finsight {

std::string csv_names_of_registers() {
  std::string text = "r0";
  for (int i = 1; i < kMeasurementRegisters; ++i) text.append(",r").append(std::to_string(i));
  return text;
}

std::string csv_of_registers(const RegisterWords& words) {
  std::string text;
  for (const std::uint16_t word : words) text.append(std::to_string(word)).append(",");
  text.pop_back();
  return text;
}

RegisterLog::RegisterLog(std::filesystem::path file, std::size_t max_blocks) : file_(std::move(file)) {
  if (!file_.empty()) blocks_.resize(max_blocks);
}

void RegisterLog::add(const RegisterImage& image) {
  if (file_.empty()) return;
  if (used_ < blocks_.size()) {
    blocks_[used_++] = image.words;
  } else {
    ++left_out_;
  }
}

std::size_t RegisterLog::write() const {
  if (file_.empty()) return 0;
  AtomicFile out(file_);
  out.write(csv_names_of_registers() + "\n");
  for (std::size_t block = 0; block < used_; ++block) out.write(csv_of_registers(blocks_[block]) + "\n");
  out.commit();
  return left_out_;
}

}  // namespace finsight
