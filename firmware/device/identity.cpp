#include "firmware/device/identity.h"

#include <array>
#include <charconv>
#include <chrono>
#include <cstdio>
#include <fstream>
#include <iterator>
#include <system_error>

namespace finsight {

namespace {

namespace fs = std::filesystem;

/// Without the zero or newline that ends it; empty if the file cannot be read.
std::string first_line(const fs::path& file) {
  std::ifstream in(file, std::ios::binary);
  std::string text{std::istreambuf_iterator<char>(in), {}};
  return text.substr(0, text.find_first_of(std::string("\n\0", 2)));
}

/// The machine id is confidential (machine-id(5)); this is not enough to find it.
std::string digits_from_machine_id() {
  const std::string id = first_line("/etc/machine-id");
  if (id.empty()) return "";
  std::uint64_t hash = 0xCBF2'9CE4'8422'2325U;  // FNV-1a
  for (const char c : "finsight" + id) hash = (hash ^ static_cast<unsigned char>(c)) * 0x100'0000'01B3U;
  std::array<char, 17> digits;
  std::snprintf(digits.data(), digits.size(), "%016llx", static_cast<unsigned long long>(hash));
  return digits.data();
}

/// As 20261122, in universal time; 0 if none of the files exists.
std::uint32_t day_of_newest(const std::vector<fs::path>& files) {
  using namespace std::chrono;
  std::optional<file_clock::time_point> newest;
  for (const fs::path& file : files) {
    std::error_code error;
    const auto written = fs::last_write_time(file, error);
    if (!error && (!newest || written > *newest)) newest = written;
  }
  if (!newest) return 0;
  const year_month_day day(floor<days>(file_clock::to_sys(*newest)));
  return static_cast<std::uint32_t>(int{day.year()}) * 10000 + unsigned{day.month()} * 100 + unsigned{day.day()};
}

/// The appliance's system writes "VERSION SLOT" there at its start.
void identify_image(const fs::path& file, DeviceIdentity& identity) {
  std::ifstream in(file);
  std::string version, slot;
  if (!(in >> version >> slot)) return;
  const std::size_t digits = std::string("2611222207").size();
  const std::string made = version.size() < digits ? "" : version.substr(version.size() - digits);
  std::from_chars(made.data(), made.data() + made.size(), identity.image_made);
  for (const NamedValue& value : row_named("image_slot").values) {
    if (slot == value.name) identity.image_slot = value.value;
  }
}

}  // namespace

DeviceIdentity identity_of(const Settings& settings, const Model* model, const fs::path& image) {
  DeviceIdentity identity;
  identify_image(image, identity);
  identity.calibration_date = settings.calibration_date;
  identity.serial_number = settings.serial_number;
  if (model) {
    identity.model_checksum = model->checksum;
    identity.model_name = model->finger_name;
  }
  if (identity.serial_number.empty()) {
    identity.serial_number = first_line("/sys/firmware/devicetree/base/serial-number");
  }
  if (identity.serial_number.empty()) identity.serial_number = digits_from_machine_id();
  if (identity.calibration_date == 0) identity.calibration_date = day_of_newest(settings.measured_files);
  return identity;
}

std::optional<float> processor_temperature_degc() {
  std::ifstream in("/sys/class/thermal/thermal_zone0/temp");
  int millidegrees = 0;
  if (!(in >> millidegrees)) return std::nullopt;
  return static_cast<float>(millidegrees) / 1000;
}

Thermometer::Thermometer(Control& control)
    : control_(control), thread_([this](const std::stop_token& stop) { run(stop); }) {}

void Thermometer::run(const std::stop_token& stop) {
  std::unique_lock lock(mutex_);
  do {
    if (const auto degc = processor_temperature_degc()) control_.show_processor_temperature(*degc);
  } while (!wait_.wait_for(lock, stop, std::chrono::seconds(1), [] { return false; }) && !stop.stop_requested());
}

}  // namespace finsight
