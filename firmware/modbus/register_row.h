// What a register is: its type, meaning, scale, bits or codes, and what may be written. register_table.h lists them
// all.
#pragma once

#include <cstdint>
#include <span>

namespace finsight {

/// kText32: up to 32 ASCII characters, two in a register, the first in the high byte; zeros behind the text.
enum class RegisterType : std::uint8_t { kUint16, kInt16, kUint32, kFloat32, kText32 };

constexpr int words_of(RegisterType type) {
  if (type == RegisterType::kText32) return 16;
  return type == RegisterType::kUint32 || type == RegisterType::kFloat32 ? 2 : 1;
}

/// How a register is to be understood. Only of a number do neighbouring values mean nearly the same. A client is an
/// IPv4 address (192.168.0.7 is 16#C0A80007); 0 is nobody, 1 the serial line.
enum class RegisterKind : std::uint8_t { kNumber, kCode, kBits, kReserved, kClient, kText };

/// One code of a register, or one bit (then `value` is its number, 0 being the lowest).
struct NamedValue {
  std::uint16_t value;
  const char* name;  ///< an identifier; PLC programs use it
  const char* note = "";
};

struct RegisterRow {
  int address;
  const char* name;
  RegisterType type;
  RegisterKind kind;
  double scale;  ///< value in `unit` = register * scale
  const char* unit;
  const char* description;
  /// What the type's invalid value (-32768, 65535 or NaN) means here; null if this register always has a value.
  const char* invalid_means = nullptr;
  std::span<const NamedValue> values = {};  ///< of bits and codes
  bool writable = false;
  std::uint16_t lowest = 0, highest = 65535;  ///< limits of what may be written
  std::uint16_t factory = 0;                  ///< a setting's value before anything was saved

  constexpr bool is_number() const { return kind == RegisterKind::kNumber; }
  constexpr bool may_be_invalid() const { return invalid_means != nullptr; }
};

// The kinds of rows.
namespace row {

constexpr RegisterRow number(int address, const char* name, RegisterType type, double scale, const char* unit,
                             const char* description) {
  return {address, name, type, RegisterKind::kNumber, scale, unit, description};
}
constexpr RegisterRow count(int address, const char* name, RegisterType type, const char* description) {
  return number(address, name, type, 1, "", description);
}
/// A number that is not always valid.
constexpr RegisterRow measured(int address, const char* name, RegisterType type, double scale, const char* unit,
                               const char* description, const char* invalid_means = "not valid") {
  RegisterRow row = number(address, name, type, scale, unit, description);
  row.invalid_means = invalid_means;
  return row;
}
constexpr RegisterRow bits(int address, const char* name, std::span<const NamedValue> values, const char* description) {
  return {.address = address,
          .name = name,
          .type = RegisterType::kUint16,
          .kind = RegisterKind::kBits,
          .scale = 1,
          .unit = "bits",
          .description = description,
          .values = values};
}
constexpr RegisterRow code(int address, const char* name, std::span<const NamedValue> values, const char* description) {
  RegisterRow row = bits(address, name, values, description);
  row.kind = RegisterKind::kCode;
  row.unit = "code";
  return row;
}
constexpr RegisterRow client(int address, const char* name, const char* description) {
  RegisterRow row = count(address, name, RegisterType::kUint32, description);
  row.kind = RegisterKind::kClient;
  row.unit = "ipv4";
  return row;
}
constexpr RegisterRow text(int address, const char* name, const char* description) {
  RegisterRow row = count(address, name, RegisterType::kText32, description);
  row.kind = RegisterKind::kText;
  return row;
}
constexpr RegisterRow reserved(int address, const char* name) {
  return {address, name, RegisterType::kUint16, RegisterKind::kReserved, 1, "", "reserved, 0"};
}
constexpr RegisterRow writable(RegisterRow row, std::uint16_t lowest, std::uint16_t highest,
                               std::uint16_t factory = 0) {
  row.writable = true;
  row.lowest = lowest;
  row.highest = highest;
  row.factory = factory;
  return row;
}
constexpr RegisterRow writable_code(RegisterRow row, std::uint16_t factory = 0) {
  return writable(row, row.values.front().value, row.values.back().value, factory);
}

}  // namespace row

}  // namespace finsight
