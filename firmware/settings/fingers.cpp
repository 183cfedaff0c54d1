// The board file of several fingers: one table each over what they share.
#include <algorithm>
#include <array>

#include "firmware/settings/settings.h"
#include "firmware/settings/toml_table.h"

namespace finsight {

namespace {

constexpr const char* kTable = "finger";
constexpr std::array kOfTheBoard = {"modbus", "network", "page", "device", "storage", kTable};

std::string read_name(TomlTable& table, const std::vector<Settings>& before) {
  constexpr std::size_t kLongest = 32;
  const std::string name = table.text("name");
  const auto is_plain = [](char c) { return (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == '-' || c == '_'; };
  const std::string found = "\"" + name + "\"";
  if (name.empty() || name.size() > kLongest || !std::ranges::all_of(name, is_plain)) {
    throw InputError(table.where("name"), "finger.name", found, "1 to 32 of a to z, 0 to 9, - and _: files bear it");
  }
  if (std::ranges::find(before, name, &Settings::name) != before.end()) {
    throw InputError(table.where("name"), "finger.name", found + " a second time", "a name of its own for each finger");
  }
  return name;
}

/// A name is a part of a camera's id or model, so one that holds another's fits that camera, too. Whether two names are
/// one camera's shows only when it is opened.
void check_camera(const Settings& finger, const Settings& other, const std::string& where) {
  constexpr auto kCamera = Settings::Source::kCamera;
  if (finger.source != kCamera || other.source != kCamera) return;
  const std::string &one = finger.camera.name, &another = other.camera.name;
  if (one.find(another) != std::string::npos || another.find(one) != std::string::npos) {
    throw InputError(where, "finger.source.camera",
                     "\"" + one + "\", and \"" + another + "\" of finger \"" + other.name + "\"",
                     "names of two cameras, neither of which is a part of the other");
  }
}

bool is_same(const GpioLine& a, const GpioLine& b) {
  return a.name.empty() == b.name.empty() && (a.name.empty() ? a.number == b.number : a.name == b.name);
}

std::string shown(const GpioLine& line) {
  return "line " + (line.name.empty() ? std::to_string(line.number) : "\"" + line.name + "\"");
}

std::vector<GpioLine> lines_of(const GpioSettings& gpio) {
  std::vector<GpioLine> lines;
  for (const auto& line : gpio.lines) {
    if (line) lines.push_back(*line);
  }
  if (gpio.trigger) lines.push_back(*gpio.trigger);
  return lines;
}

void check_own_lines(const Settings& finger, const std::string& where) {
  if (!finger.gpio) return;
  std::vector<GpioLine> before;
  for (const GpioLine& line : lines_of(*finger.gpio)) {
    const bool is_taken = std::ranges::any_of(before, [&](const GpioLine& taken) { return is_same(line, taken); });
    if (is_taken) throw InputError(where, "gpio", shown(line) + " a second time", "a line of its own for each key");
    before.push_back(line);
  }
}

void check_lines(const Settings& finger, const Settings& other, const std::string& where) {
  if (!finger.gpio || !other.gpio || finger.gpio->chip != other.gpio->chip) return;
  for (const GpioLine& line : lines_of(*finger.gpio)) {
    for (const GpioLine& taken : lines_of(*other.gpio)) {
      if (!is_same(line, taken)) continue;
      throw InputError(where, "finger.gpio", shown(line) + ", which finger \"" + other.name + "\" has",
                       "lines of its own");
    }
  }
}

void check_processor(const Settings& finger, const Settings& other, const std::string& where) {
  const int cpu = finger.realtime.cpu;
  if (cpu < 0 || cpu != other.realtime.cpu) return;
  throw InputError(where, "finger.realtime.cpu", std::to_string(cpu) + ", which finger \"" + other.name + "\" has",
                   "a processor of its own, or -1");
}

/// Each finger has a page of its own, at the next port.
void number_pages(std::vector<Settings>& fingers, const std::string& where) {
  for (std::size_t i = 0; i < fingers.size(); ++i) {
    if (!fingers[i].page) return;
    fingers[i].page->port += static_cast<int>(i);
    if (fingers[i].page->port == fingers[i].modbus.port) {
      throw InputError(where, "page.port", std::to_string(fingers[0].page->port),
                       "a port that leaves " + std::to_string(fingers[i].modbus.port) +
                           " to Modbus; each finger's page has one of its own, from this on");
    }
    if (fingers[i].page->port <= 65535) continue;
    throw InputError(where, "page.port", std::to_string(fingers[0].page->port),
                     "room for the other fingers' pages behind it, up to 65535");
  }
}

/// A finger has the same unit id on TCP and on the serial line: a program that changes from one to the other must not
/// reach another finger.
void check_units(std::vector<Settings>& fingers, TomlTable modbus) {
  const bool has_serial_unit = modbus.has("serial") && modbus.table("serial").has("unit");
  const int first = std::max(fingers.front().modbus.unit, 1), last = first + static_cast<int>(fingers.size()) - 1;
  const std::string units = std::to_string(first) + " to " + std::to_string(last);
  for (std::size_t i = 0; i < fingers.size(); ++i) fingers[i].unit = first + static_cast<int>(i);
  if (last > 247) {
    throw InputError(modbus.where("unit"), "modbus.unit", "units " + units + " for the fingers", "units up to 247");
  }
  for (Settings& finger : fingers) {
    auto& serial = finger.modbus.serial;
    if (!serial) continue;
    if (!has_serial_unit) serial->unit = first;
    if (serial->unit == first) continue;
    throw InputError(
        modbus.table("serial").where("unit"), "modbus.serial.unit", std::to_string(serial->unit),
        std::to_string(first) + ", as with TCP (modbus.unit): the fingers are units " + units + " on both");
  }
}

}  // namespace

std::vector<Settings> read_fingers(const SettingsFiles& files, Measured measured) {
  TomlTable root = files.merged();
  if (!root.has(kTable)) {
    Settings alone = read_finger(root, "", measured);
    check_own_lines(alone, root.where("gpio"));
    if (alone.modbus.unit != 0) alone.unit = alone.modbus.unit;
    return {alone};
  }
  std::vector<TomlTable> tables = root.tables(kTable);
  if (tables.size() > kMostFingers) {
    throw InputError(root.where(kTable), kTable, std::to_string(tables.size()) + " tables", "at most 4");
  }
  const TomlTable modbus = root.table("modbus");  // if it is missing, that is no finger's fault
  std::vector<Settings> fingers;
  for (TomlTable& table : tables) {
    const std::string name = read_name(table, fingers), where = table.where();
    for (const char* key : kOfTheBoard) {
      if (!table.has(key)) continue;
      throw InputError(table.where(key), "finger." + std::string(key), "in a finger",
                       "at the file's top: it is the board's");
    }
    TomlTable merged = TomlTable::merged(table, root);
    merged.has_been_read({"name", kTable});
    Settings finger = read_finger(std::move(merged), name, measured);
    check_own_lines(finger, table.where("gpio"));
    for (const Settings& other : fingers) {
      check_camera(finger, other, where);
      check_lines(finger, other, where);
      check_processor(finger, other, where);
    }
    fingers.push_back(std::move(finger));
  }
  check_units(fingers, modbus);
  if (root.has("page")) number_pages(fingers, root.table("page").where("port"));
  return fingers;
}

std::vector<Settings> read_usable_fingers(const SettingsFiles& files) {
  const Settings shared = read_usable_settings(files);
  try {
    TomlTable root = files.merged();
    std::vector<Settings> fingers;
    for (const TomlTable& table : root.tables(kTable)) {
      if (fingers.size() == kMostFingers) break;
      Settings& finger = fingers.emplace_back(shared);
      try {
        finger.gpio = read_outputs(TomlTable::merged(table, root));
      } catch (const InputError&) {
        finger.gpio.reset();  // read_fingers() says what is wrong with it
      }
    }
    return fingers;
  } catch (const InputError&) {
    return {shared};  // there is no such table
  }
}

Settings read_settings(const SettingsFiles& files) { return read_fingers(files).front(); }

}  // namespace finsight
