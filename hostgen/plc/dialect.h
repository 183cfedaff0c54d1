// Structured Text and Siemens SCL: how they differ, and how both convert a register.
#pragma once

#include <sstream>
#include <string>

#include "hostgen/plc/row_text.h"

namespace finsight::host {

/// How the two languages differ.
struct Dialect {
  const char* local;         ///< prefix of parameters and temporary variables
  const char* target;        ///< prefix of the scaled values
  const char* decode_real;   ///< function from the bits of a float32 to a REAL
  const char* shift_before;  ///< text around the operand of a shift by 16 bits to the left
  const char* shift_after;
  const char* comment_begin;
  const char* comment_end;
  int first = 0;  ///< address of the first of `words`
};
inline constexpr Dialect kStructuredText = {"", "", "FC_FinsightReal", "SHL(", ", 16)", "(* ", " *)"};
inline constexpr Dialect kScl = {"#", "#values.", "DWORD_TO_REAL", "SHL(IN := ", ", N := 16)", "// ", ""};

inline bool is_scaled(const RegisterRow& row) { return row.scale != 1 || row.type == RegisterType::kInt16; }

inline std::string hexadecimal(std::uint32_t value) {
  std::ostringstream text;
  text << "16#" << std::hex << std::uppercase << value;
  return text.str();
}

inline std::string word(const Dialect& dialect, int address) {
  return std::string(dialect.local) + "words[" + std::to_string(address - dialect.first) + "]";
}

/// The variable that holds both words of a 32-bit register.
inline std::string pair(const Dialect& dialect, const RegisterRow& row) {
  return std::string(dialect.local) + "pair_" + std::to_string(row.address);
}

inline std::string converted(const Dialect& dialect, const RegisterRow& row) {
  if (is_float(row)) return std::string(dialect.decode_real) + "(" + pair(dialect, row) + ")";
  if (words_of(row.type) == 2) return std::string("DWORD_TO_UDINT(") + pair(dialect, row) + ")";
  const std::string raw = word(dialect, row.address);
  if (!is_scaled(row)) return std::string("WORD_TO_UINT(") + raw + ")";
  const bool is_signed = row.type == RegisterType::kInt16;
  std::ostringstream text;
  text << (is_signed ? "INT_TO_REAL(WORD_TO_INT(" : "UINT_TO_REAL(WORD_TO_UINT(") << raw << "))";
  if (row.scale != 1) text << " * " << row.scale;
  return text.str();
}

inline std::string validity(const Dialect& dialect, const RegisterRow& row) {
  if (is_float(row)) return std::string("(") + pair(dialect, row) + " AND DWORD#16#7F800000) <> DWORD#16#7F800000";
  return word(dialect, row.address) + " <> WORD#16#" + (row.type == RegisterType::kInt16 ? "8000" : "FFFF");
}

inline std::string type_of(const RegisterRow& row) {
  if (is_float(row) || is_scaled(row)) return "REAL";
  return words_of(row.type) == 2 ? "UDINT" : "UINT";
}

/// What the block of all fingers becomes in each of them, see plc_files.h.
std::string gripper_structured_text(const RegisterTable& table);
std::string gripper_scl(const RegisterTable& table);

}  // namespace finsight::host
