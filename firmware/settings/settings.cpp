#include "firmware/settings/settings.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <iterator>
#include <utility>

#include "firmware/input_error.h"
#include "firmware/settings/measured_fit.h"
#include "firmware/settings/toml_table.h"

namespace finsight {

namespace {

void read_replay(TomlTable& table, Settings& settings) {
  settings.replay.path = table.path("path");
  if (settings.source == Settings::Source::kPoses) settings.replay.recording = table.text("recording", "");
  settings.replay.recorded_speed = table.choice("speed", {"recorded", "full"}, "recorded") == "recorded";
  settings.replay.repeat = table.flag("repeat", false);
}

/// Gives the file to `read`. If it cannot be used, that is one finger's fault alone: its Sensor throws it.
template <class Read>
void read_own_file(const std::filesystem::path& file, Settings& settings, const Read& read) {
  try {
    read(TomlTable::parse_file(file));
  } catch (const InputError& error) {
    if (settings.name.empty()) throw;  // there is no other finger
    settings.unusable = error;
  }
}

/// Gives the table, or the file that stands for it, to `read`.
template <class Read>
void read_table_or_file(TomlTable& parent, const char* key, Settings& settings, const Read& read) {
  const auto file = parent.file_instead_of_table(key);
  if (!file) return read(parent.table(key));
  settings.measured_files.push_back(*file);
  read_own_file(*file, settings, read);
}

void read_live(TomlTable& table, Settings& settings) {
  LiveCameraSettings& live = settings.camera;
  live.name = table.text("camera", "");
  live.width_px = static_cast<int>(table.integer("width_px", 16, Y4mReader::kMaxSide));
  live.height_px = static_cast<int>(table.integer("height_px", 16, Y4mReader::kMaxSide));
  live.frames_per_second = table.number("frames_per_second", 1, 1000);
  if (table.has("coding")) live.coding = read_coding(table);
  if (table.has("readout_ms")) live.readout_ms = read_readout_ms(table);
  if (table.has("exposure_us")) live.exposure_us = static_cast<int>(table.integer("exposure_us", 1, 1'000'000));
  if (table.has("gain")) live.gain = table.number("gain", 0.01, 1000);
  live.stall_ms = static_cast<int>(table.integer("stall_ms", 50, 60'000, 500));
  read_table_or_file(table, "lens", settings, [&](TomlTable lens) {
    settings.lens = read_lens(std::move(lens), live.width_px, live.height_px);
  });
}

void read_source(TomlTable table, Settings& settings) {
  using Source = Settings::Source;
  const std::string kind = table.choice("kind", {"session", "poses", "camera"});
  settings.source = kind == "session" ? Source::kSession : kind == "poses" ? Source::kPoses : Source::kCamera;
  settings.source == Source::kCamera ? read_live(table, settings) : read_replay(table, settings);
  table.finish();
}

GpioLine read_line(TomlTable& table) {
  GpioLine line;
  if (table.has("name") == table.has("number")) {
    throw InputError(table.where(), "a line has either a name or a number");
  }
  if (table.has("name")) {
    line.name = table.text("name");
    if (line.name.empty()) throw InputError(table.where("name"), "name", "\"\"", "the name of a line");
  } else {
    line.number = static_cast<unsigned>(table.integer("number", 0, 1023));
  }
  line.active_low = table.flag("active_low", false);
  return line;
}

/// There is no default for `safe`: it depends on how the machine is wired. Healthy and the light are safe when
/// inactive.
OutputLine read_output(TomlTable table, int output) {
  OutputLine line{read_line(table)};
  const bool has_safe_level = output == kContactOutput || output == kOverloadOutput;
  if (has_safe_level) line.safe_active = table.choice("safe", {"active", "inactive"}) == "active";
  table.finish();
  return line;
}

GpioSettings read_gpio(TomlTable table) {
  GpioSettings gpio;
  gpio.chip = table.text("chip");
  gpio.consumer = table.text("consumer", "finsight");
  bool any = false;
  for (int output = 0; output < kOutputs; ++output) {
    if (!table.has(kOutputName[output])) continue;
    gpio.lines[output] = read_output(table.table(kOutputName[output]), output);
    any = true;
  }
  if (table.has("trigger")) {
    TomlTable trigger = table.table("trigger");
    gpio.trigger = read_line(trigger);
    trigger.finish();
    any = true;
  }
  if (!any) throw InputError(table.where(), "gpio", "no line", "contact, overload, healthy, light or trigger");
  table.finish();
  return gpio;
}

void read_shape(TomlTable table, ShapeSettings& shape) {
  std::vector<std::string> names;
  for (const auto& [name, tier] : kShapeTiers) names.emplace_back(name);
  const std::string chosen = table.choice("tier", names, "best");
  for (const auto& [name, tier] : kShapeTiers) {
    if (chosen == name) shape.tier = tier;
  }
  shape.factorisations = static_cast<int>(table.integer("factorisations", 1, 10, shape.factorisations));
  shape.chord_steps = static_cast<int>(table.integer("chord_steps", 0, 5, shape.chord_steps));
  table.finish();
}

char parity_letter(const std::string& parity) { return parity == "even" ? 'E' : parity == "odd" ? 'O' : 'N'; }

SerialSettings read_serial(TomlTable table) {
  SerialSettings serial;
  serial.device = table.text("device");
  if (!serial.device.starts_with("/")) {
    throw InputError(table.where("device"), "modbus.serial.device", "\"" + serial.device + "\"",
                     "a device's whole path, such as \"/dev/ttyUSB0\"");
  }
  constexpr int kBauds[] = {1200, 2400, 4800, 9600, 19200, 38400, 57600, 115200};
  serial.baud = static_cast<int>(table.integer("baud", 1200, 115200, serial.baud));
  if (std::ranges::find(kBauds, serial.baud) == std::end(kBauds)) {
    throw InputError(table.where("baud"), "modbus.serial.baud", std::to_string(serial.baud),
                     "1200, 2400, 4800, 9600, 19200, 38400, 57600 or 115200");
  }
  serial.parity = parity_letter(table.choice("parity", {"even", "odd", "none"}, "even"));
  serial.stop_bits = static_cast<int>(table.integer("stop_bits", 1, 2, serial.parity == 'N' ? 2 : 1));
  serial.unit = static_cast<int>(table.integer("unit", 1, 247, serial.unit));
  serial.rs485 = table.flag("rs485", false);
  table.finish();
  return serial;
}

std::vector<Network> read_networks(TomlTable& table, const char* key, const std::string& section = "modbus") {
  std::vector<Network> networks;
  if (!table.has(key)) return networks;
  for (const std::string& text : table.texts(key)) {
    const auto network = Network::parse(text);
    if (!network) {
      throw InputError(table.where(key), section + "." + key, "\"" + text + "\"",
                       "an address or a network, such as \"192.168.0.7\" or \"192.168.0.0/24\"");
    }
    networks.push_back(*network);
  }
  return networks;
}

std::vector<std::uint32_t> read_reserved(TomlTable& table, const ModbusSettings& modbus) {
  std::vector<std::uint32_t> addresses;
  for (const Network& network : read_networks(table, "reserve")) {
    if (!network.is_address()) {
      throw InputError(table.where("reserve"), "modbus.reserve", "a network", "addresses, such as \"192.168.0.7\"");
    }
    if (!is_listed(modbus.allow, network.address)) {
      throw InputError(table.where("reserve"), "modbus.reserve: an address that `allow` does not let in");
    }
    if (std::ranges::find(addresses, network.address) == addresses.end()) addresses.push_back(network.address);
  }
  if (addresses.size() >= static_cast<std::size_t>(modbus.max_clients)) {
    const std::string found = addresses.size() == 1 ? "1 address" : std::to_string(addresses.size()) + " addresses";
    throw InputError(table.where("reserve"), "modbus.reserve", found,
                     "fewer than max_clients, which is " + std::to_string(modbus.max_clients));
  }
  return addresses;
}

/// The device's own key, which its system has made. Without a usable file nobody can write.
std::uint16_t key_in(const std::filesystem::path& file) {
  std::ifstream in(file);
  int key = 0;
  return in >> key && key > 0 && key <= 65535 ? static_cast<std::uint16_t>(key) : kNoWriteKey;
}

void read_modbus(TomlTable table, Settings& settings) {
  ModbusSettings& modbus = settings.modbus;
  modbus.address = table.text("address", modbus.address);
  if (!is_ipv4(modbus.address, false)) {
    throw InputError(table.where("address"), "modbus.address", "\"" + modbus.address + "\"", "an IPv4 address");
  }
  modbus.port = static_cast<int>(table.integer("port", 0, 65535, modbus.port));
  modbus.max_clients =
      static_cast<int>(table.integer("max_clients", 1, ModbusSettings::kMostClients, modbus.max_clients));
  if (table.has("max_per_address")) {
    modbus.max_per_address = static_cast<int>(table.integer("max_per_address", 1, ModbusSettings::kMostClients));
    if (modbus.max_per_address > modbus.max_clients) {
      throw InputError(table.where("max_per_address"), "modbus.max_per_address", std::to_string(modbus.max_per_address),
                       "at most max_clients, which is " + std::to_string(modbus.max_clients));
    }
  }
  modbus.idle_limit_s = static_cast<int>(table.integer("idle_limit_s", 1, 86400, modbus.idle_limit_s));
  modbus.unit = static_cast<int>(table.integer("unit", 0, 247, modbus.unit));
  modbus.allow = read_networks(table, "allow");
  modbus.allow_writes = read_networks(table, "allow_writes");
  modbus.reserve = read_reserved(table, modbus);
  if (table.has("write_key_file")) settings.write_key = key_in(table.path("write_key_file"));
  settings.write_key = static_cast<std::uint16_t>(table.integer("write_key", 1, 65535, settings.write_key));
  const bool low_word_first = table.choice("word_order", {"ABCD", "CDAB"}, "ABCD") == "CDAB";
  settings.loop.runtime[kWordOrder] =
      low_word_first ? value_named("word_order", "CDAB") : value_named("word_order", "ABCD");
  if (table.has("serial")) modbus.serial = read_serial(table.table("serial"));
  table.finish();
}

PageSettings read_page(TomlTable table) {
  PageSettings page;
  page.address = table.text("address", page.address);
  if (!is_ipv4(page.address, false)) {
    throw InputError(table.where("address"), "page.address", "\"" + page.address + "\"", "an IPv4 address");
  }
  page.port = static_cast<int>(table.integer("port", 1, 65535, page.port));
  page.local_link_only = table.flag("local_link_only", false);
  page.allow = read_networks(table, "allow", "page");
  page.allow_writes = read_networks(table, "allow_writes", "page");
  if (table.has("names")) page.names = table.texts("names");
  if (table.has("folder")) page.folder = table.path("folder");
  if (table.has("measured")) page.measured = table.path("measured");
  if (table.has("updates")) page.updates = table.path("updates");
  table.finish();
  return page;
}

/// What was measured on the page, where there is such a file.
void use_measured(const std::filesystem::path& folder, Settings& settings) {
  if (const auto mount = folder / kMeasuredMount; std::filesystem::is_regular_file(mount)) {
    read_own_file(mount, settings, [&](TomlTable table) { settings.mount = read_measured_mount(std::move(table)); });
    settings.measured_files.push_back(mount);
  }
  if (const auto fit = folder / kMeasuredFit; std::filesystem::is_regular_file(fit)) {
    read_own_file(fit, settings, [&](TomlTable table) { settings.loop.fit = read_measured_fit(std::move(table)); });
    settings.fit_where = fit.string();
    settings.fit_is_stored = true;
  }
  const auto lens = folder / kMeasuredLens;
  if (!std::filesystem::is_regular_file(lens)) return;
  settings.measured_lens = lens;
  settings.measured_files.push_back(lens);
  const LiveCameraSettings& live = settings.camera;
  if (settings.source == Settings::Source::kCamera) {
    read_own_file(lens, settings,
                  [&](TomlTable table) { settings.lens = read_lens(std::move(table), live.width_px, live.height_px); });
  }
}

void read_realtime(TomlTable table, RealtimeSettings& realtime) {
  realtime.priority = static_cast<int>(table.integer("priority", 0, 50, 0));
  realtime.cpu = static_cast<int>(table.integer("cpu", -1, 255, -1));
  realtime.lock_memory = table.flag("lock_memory", false);
  table.finish();
}

void read_network(TomlTable table, NetworkSettings& network) {
  if (table.choice("method", {"dhcp", "static"}) == "static") {
    network.address = table.text("address");
    network.gateway = table.text("gateway", "");
    const std::optional<Network> own = Network::parse(network.address);
    if (!is_ipv4(network.address, true) || !is_host(*own)) {
      throw InputError(table.where("address"), "network.address", "\"" + network.address + "\"",
                       "a device's address with its prefix length, such as \"192.168.0.40/24\"");
    }
    if (network.gateway.empty()) return table.finish();
    const std::optional<Network> gateway = Network::parse(network.gateway);
    const bool is_another = gateway && is_host({gateway->address, own->mask}) && own->contains(gateway->address) &&
                            gateway->address != own->address;
    if (!is_ipv4(network.gateway, false) || !is_another) {
      throw InputError(table.where("gateway"), "network.gateway", "\"" + network.gateway + "\"",
                       "another device's address in the network of " + network.address);
    }
  }
  table.finish();
}

/// "2026-11-22" as 20261122.
std::uint32_t read_date(TomlTable& table, const char* key) {
  const std::string text = table.text(key);
  int year = 0, month = 0, day = 0;
  std::string form = text;
  std::ranges::replace_if(
      form, [](char c) { return c >= '0' && c <= '9'; }, '0');
  if (form == "0000-00-00") std::sscanf(text.c_str(), "%4d-%2d-%2d", &year, &month, &day);
  const std::chrono::year_month_day date{std::chrono::year(year), std::chrono::month(static_cast<unsigned>(month)),
                                         std::chrono::day(static_cast<unsigned>(day))};
  if (!date.ok()) {
    throw InputError(table.where(key), std::string("device.") + key, "\"" + text + "\"",
                     "a date, such as \"2026-11-22\"");
  }
  return static_cast<std::uint32_t>(10000 * year + 100 * month + day);
}

void read_device(TomlTable table, Settings& settings) {
  constexpr std::size_t kMaxSerial = 2 * words_of(RegisterType::kText32);
  settings.serial_number = table.text("serial_number", "");
  const auto is_ascii = [](char c) { return c >= ' ' && c <= '~'; };
  if (settings.serial_number.size() > kMaxSerial || !std::ranges::all_of(settings.serial_number, is_ascii)) {
    throw InputError(table.where("serial_number"), "device.serial_number", "\"" + settings.serial_number + "\"",
                     "at most 32 ASCII characters");
  }
  if (table.has("calibration_date")) settings.calibration_date = read_date(table, "calibration_date");
  table.finish();
}

void read_gravity(TomlTable table, Settings& settings) {
  const bool is_fixed = table.choice("from", {"fixed", "registers"}) == "fixed";
  if (is_fixed) {
    const auto g = table.numbers("direction_g", 3, -1.01, 1.01);
    settings.fixed_g = Eigen::Vector3d(g[0], g[1], g[2]).cast<float>();
  } else {
    settings.gravity_max_age_ms = static_cast<int>(table.integer("max_age_ms", 10, 60'000, 500));
  }
  table.finish();
}

void read_fit(TomlTable& root, Settings& settings) {
  read_table_or_file(root, "fit", settings, [&](TomlTable table) {
    settings.fit_where = table.where();
    settings.loop.fit = read_measured_fit(std::move(table));
  });
}

void read_mount(TomlTable& root, Settings& settings) {
  read_table_or_file(root, "mount", settings,
                     [&](TomlTable table) { settings.mount = read_measured_mount(std::move(table)); });
}

void read_storage(TomlTable table, Settings& settings) {
  if (table.has("settings")) settings.saved_state = table.path("settings");
  if (table.has("recordings")) settings.recordings = table.path("recordings");
  settings.record_max_s = static_cast<int>(table.integer("record_max_s", 1, 65535, settings.record_max_s));
  settings.record_reserve_mb =
      static_cast<int>(table.integer("record_reserve_mb", 0, 1'000'000, settings.record_reserve_mb));
  table.finish();
}

/// Files and folders that the board file names are those of the only finger.
void store_under_name(Settings& settings) {
  const std::string& name = settings.name;
  if (std::filesystem::path& file = settings.saved_state; !file.empty()) {
    file.replace_filename(file.stem().string() + "-" + name + file.extension().string());
  }
  if (!settings.recordings.empty()) settings.recordings /= name;
  if (!settings.page) return;
  settings.page->folder /= name;
  if (!settings.page->measured.empty()) settings.page->measured /= name;
}

}  // namespace

SettingsFiles::SettingsFiles(const std::filesystem::path& board, const std::filesystem::path& user) {
  try {
    versions_.push_back(TomlTable::parse_file(board));
    if (!user.empty())
      versions_.insert(versions_.begin(), TomlTable::merged(TomlTable::parse_file(user), versions_[0]));
  } catch (const InputError& error) {
    error_ = error;
  }
}

TomlTable SettingsFiles::merged() const {
  if (error_) throw *error_;
  return versions_.front();
}

Settings read_finger(TomlTable root, const std::string& name, Measured measured) {
  Settings settings;
  settings.name = name;
  settings.pack = root.path("pack");
  read_source(root.table("source"), settings);
  if (root.has("shape")) read_shape(root.table("shape"), settings.loop.shape);
  read_modbus(root.table("modbus"), settings);
  if (root.has("gpio")) settings.gpio = read_gpio(root.table("gpio"));
  std::uint16_t& hold_ms = settings.loop.runtime[kHoldTime];
  hold_ms = static_cast<std::uint16_t>(root.integer("hold_time_ms", 0, setting_row(kHoldTime).highest, hold_ms));
  const RegisterRow& lowpass = setting_row(kLowpass);
  settings.loop.runtime[kLowpass] = static_cast<std::uint16_t>(
      std::lround(root.number("lowpass_hz", 0, lowpass.highest * lowpass.scale, 0) / lowpass.scale));
  const RegisterRow& grip_change = setting_row(kGripChange);
  settings.loop.runtime[kGripChange] = static_cast<std::uint16_t>(std::lround(
      root.number("grip_change", 0, grip_change.highest * grip_change.scale, grip_change.factory * grip_change.scale) /
      grip_change.scale));
  settings.loop.smoothing_ms = static_cast<double>(root.integer("smoothing_ms", 0, 1000, 0));
  if (root.has("gravity")) read_gravity(root.table("gravity"), settings);
  if (root.has("storage")) read_storage(root.table("storage"), settings);
  if (root.has("realtime")) read_realtime(root.table("realtime"), settings.realtime);
  if (root.has("network")) read_network(root.table("network"), settings.network);
  if (root.has("page")) settings.page = read_page(root.table("page"));
  if (root.has("device")) read_device(root.table("device"), settings);
  if (root.has("fit")) read_fit(root, settings);
  if (root.has("mount")) read_mount(root, settings);
  root.finish();
  if (!name.empty()) store_under_name(settings);
  const bool has_measured = settings.page && !settings.page->measured.empty();
  if (has_measured && measured == Measured::kUsed) use_measured(settings.page->measured, settings);
  return settings;
}

NetworkSettings read_network_settings(const SettingsFiles& files) {
  TomlTable root = files.merged();
  NetworkSettings network;
  if (root.has("network")) read_network(root.table("network"), network);
  return network;
}

namespace {

/// Gives a table of the merged files to `read`, then the board file's if that throws InputError.
template <class Read>
void read_usable(const SettingsFiles& files, const char* name, const Read& read) {
  for (TomlTable root : files.versions()) {
    try {
      if (root.has(name)) read(root.table(name));
      return;
    } catch (const InputError&) {
      // read_fingers() says what is wrong with it.
    }
  }
}

}  // namespace

Settings read_usable_settings(const SettingsFiles& files) {
  Settings settings;
  settings.modbus.address = "0.0.0.0";
  // Each into a copy: a table that is refused half-way leaves nothing behind.
  read_usable(files, "modbus", [&](TomlTable table) {
    Settings part = settings;
    read_modbus(std::move(table), part);
    settings = part;
  });
  read_usable(files, "storage", [&](TomlTable table) {
    Settings part = settings;
    read_storage(std::move(table), part);
    settings = part;
  });
  read_usable(files, "page", [&](TomlTable table) { settings.page = read_page(std::move(table)); });
  read_usable(files, "device", [&](TomlTable table) {
    Settings part = settings;
    read_device(std::move(table), part);
    settings = part;
  });
  read_usable(files, "gpio", [&](TomlTable table) { settings.gpio = read_gpio(std::move(table)); });
  return settings;
}

std::optional<GpioSettings> read_outputs(TomlTable root) {
  return root.has("gpio") ? std::optional(read_gpio(root.table("gpio"))) : std::nullopt;
}

}  // namespace finsight
