#include "firmware/device/register_log.h"

#include <string>

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

RegisterLog::RegisterLog(const std::filesystem::path& file, std::size_t max_blocks) {
  if (file.empty()) return;
  file_.emplace(file);
  blocks_.resize(max_blocks);
}

void RegisterLog::add(const RegisterImage& image) {
  if (!file_) return;
  if (used_ < blocks_.size()) {
    blocks_[used_++] = image.words;
  } else {
    ++left_out_;
  }
}

std::size_t RegisterLog::write() {
  if (!file_) return 0;
  file_->write(csv_names_of_registers() + "\n");
  for (std::size_t block = 0; block < used_; ++block) file_->write(csv_of_registers(blocks_[block]) + "\n");
  file_->commit();
  return left_out_;
}

}  // namespace finsight
