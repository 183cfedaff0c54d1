#include "firmware/settings.h"

#include <arpa/inet.h>

#include "firmware/input_error.h"
#include "firmware/toml_table.h"

namespace finsight {

namespace {

void read_source(TomlTable table, Settings& settings) {
  const bool session = table.choice("kind", {"session", "poses"}) == "session";
  settings.source = session ? Settings::Source::kSession : Settings::Source::kPoses;
  settings.replay.path = table.path("path");
  if (!session) settings.replay.recording = table.text("recording", "");
  settings.replay.recorded_speed = table.choice("speed", {"recorded", "full"}, "recorded") == "recorded";
  settings.replay.repeat = table.flag("repeat", false);
  table.finish();
}

void read_shape(TomlTable table, ShapeSettings& shape) {
  using Tier = ShapeSettings::Tier;
  const std::string tier = table.choice("tier", {"map", "map+newton", "newton"}, "newton");
  shape.tier = tier == "map" ? Tier::kMap : tier == "newton" ? Tier::kNewton : Tier::kMapAndNewton;
  shape.factorisations = static_cast<int>(table.integer("factorisations", 1, 10, shape.factorisations));
  shape.chord_steps = static_cast<int>(table.integer("chord_steps", 0, 5, shape.chord_steps));
  table.finish();
}

void read_modbus(TomlTable table, Settings& settings) {
  ModbusSettings& modbus = settings.modbus;
  modbus.address = table.text("address", modbus.address);
  in_addr ignored;
  if (inet_pton(AF_INET, modbus.address.c_str(), &ignored) != 1) {
    throw InputError(table.where("address"), "modbus.address", "\"" + modbus.address + "\"", "an IPv4 address");
  }
  modbus.port = static_cast<int>(table.integer("port", 0, 65535, modbus.port));
  modbus.max_clients = static_cast<int>(table.integer("max_clients", 1, 64, modbus.max_clients));
  modbus.idle_limit_s = static_cast<int>(table.integer("idle_limit_s", 1, 86400, modbus.idle_limit_s));
  const std::string order = table.choice("word_order", {"ABCD", "CDAB"}, "ABCD");
  settings.loop.word_order = order == "ABCD" ? WordOrder::kABCD : WordOrder::kCDAB;
  table.finish();
}

}  // namespace

Settings read_settings(const std::filesystem::path& file) {
  TomlTable root = TomlTable::parse_file(file);
  Settings settings;
  settings.pack = root.path("pack");
  read_source(root.table("source"), settings);
  if (root.has("shape")) read_shape(root.table("shape"), settings.loop.shape);
  read_modbus(root.table("modbus"), settings);
  constexpr std::int64_t kNsPerMs = 1'000'000;
  settings.loop.hold_time_ns = kNsPerMs * root.integer("hold_time_ms", 0, 10000, settings.loop.hold_time_ns / kNsPerMs);
  root.finish();
  return settings;
}

CameraModel camera_of(const SessionInfo& session) {
  const auto f = [](double value) { return static_cast<float>(value); };
  const auto& c = session.fx_fy_cx_cy;
  const auto& k = session.k1_k2_p1_p2_k3;
  return {session.width_px, session.height_px, f(c[0]), f(c[1]), f(c[2]), f(c[3]),
          f(k[0]),          f(k[1]),           f(k[2]), f(k[3]), f(k[4])};
}

}  // namespace finsight
