// The register table as a PLC's source code: Structured Text and Siemens SCL.
#include <sstream>

#include "hostgen/plc/plc_files.h"
#include "hostgen/plc/row_text.h"

namespace finsight::host {

namespace {

/// How the two languages differ.
struct Dialect {
  const char* local;         ///< prefix of parameters and temporary variables
  const char* target;        ///< prefix of the scaled values
  const char* decode_real;   ///< function from the bits of a float32 to a REAL
  const char* shift_before;  ///< text around the operand of a shift by 16 bits to the left
  const char* shift_after;
  const char* comment_begin;
  const char* comment_end;
};
constexpr Dialect kStructuredText = {"", "", "FC_FinsightReal", "SHL(", ", 16)", "(* ", " *)"};
constexpr Dialect kScl = {"#", "#values.", "DWORD_TO_REAL", "SHL(IN := ", ", N := 16)", "// ", ""};

bool is_scaled(const RegisterRow& row) { return row.scale != 1 || row.type == RegisterType::kInt16; }

std::string hexadecimal(std::uint32_t value) {
  std::ostringstream text;
  text << "16#" << std::hex << std::uppercase << value;
  return text.str();
}

std::string word(const Dialect& dialect, int address) {
  return std::string(dialect.local) + "words[" + std::to_string(address) + "]";
}

/// The variable that holds both words of a 32-bit register.
std::string pair(const Dialect& dialect, const RegisterRow& row) {
  return std::string(dialect.local) + "pair_" + std::to_string(row.address);
}

std::string converted(const Dialect& dialect, const RegisterRow& row) {
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

std::string validity(const Dialect& dialect, const RegisterRow& row) {
  if (is_float(row)) return std::string("(") + pair(dialect, row) + " AND DWORD#16#7F800000) <> DWORD#16#7F800000";
  return word(dialect, row.address) + " <> WORD#16#" + (row.type == RegisterType::kInt16 ? "8000" : "FFFF");
}

std::string type_of(const RegisterRow& row) {
  if (is_float(row) || is_scaled(row)) return "REAL";
  return words_of(row.type) == 2 ? "UDINT" : "UINT";
}

/// Declarations of all values, one per line.
std::string declarations(const RegisterTable& table, const Dialect& dialect, const std::string& indent) {
  std::ostringstream text;
  const auto comment = [&](const std::string& what) {
    return std::string("  ") + dialect.comment_begin + what + dialect.comment_end + "\n";
  };
  for (const RegisterRow& row : table.measurements) {
    if (is_reserved(row)) continue;
    const std::string at = "register " + std::to_string(row.address);
    if (is_bits(row)) {
      for (const NamedValue& bit : row.values) {
        text << indent << variable_of(row, bit) << " : BOOL;" << comment(at + ", bit " + std::to_string(bit.value));
      }
      continue;
    }
    text << indent << variable_of(row) << " : " << type_of(row) << ";" << comment(at + ": " + full_description(row));
    if (row.may_be_invalid()) text << indent << row.name << "_valid : BOOL;\n";
  }
  return text.str();
}

std::string bit_assignments(const Dialect& dialect, const RegisterRow& row) {
  std::string text;
  for (const NamedValue& bit : row.values) {
    text += std::string("  ") + dialect.target + variable_of(row, bit) + " := (" + word(dialect, row.address) +
            " AND WORD#" + hexadecimal(1U << bit.value) + ") <> WORD#16#0;\n";
  }
  return text;
}

/// Assignments of all values. An invalid one becomes 0.
std::string assignments(const RegisterTable& table, const Dialect& dialect) {
  std::ostringstream text;
  for (const RegisterRow& row : table.measurements) {
    if (is_reserved(row)) continue;
    if (is_bits(row)) {
      text << bit_assignments(dialect, row);
      continue;
    }
    const std::string variable = dialect.target + variable_of(row), value = converted(dialect, row);
    if (row.may_be_invalid()) {
      const std::string valid = std::string(dialect.target) + row.name + "_valid";
      text << "  " << valid << " := " << validity(dialect, row) << ";\n"
           << "  IF " << valid << " THEN " << variable << " := " << value << "; ELSE " << variable
           << " := " << (type_of(row) == "REAL" ? "0.0" : "0") << "; END_IF;\n";
    } else {
      text << "  " << variable << " := " << value << ";\n";
    }
  }
  return text.str();
}

/// Joins the two words of every 32-bit register in the order that is set.
std::string pair_assignments(const RegisterTable& table, const Dialect& dialect) {
  std::ostringstream text;
  for (const RegisterRow& row : table.measurements) {
    if (words_of(row.type) != 2) continue;
    const auto joined = [&](int high, int low) {
      return std::string(dialect.shift_before) + "WORD_TO_DWORD(" + word(dialect, high) + ")" + dialect.shift_after +
             " OR WORD_TO_DWORD(" + word(dialect, low) + ")";
    };
    const std::string name = pair(dialect, row);
    text << "  IF " << dialect.local << "low_word_first THEN " << name << " := " << joined(row.address + 1, row.address)
         << ";\n  ELSE " << name << " := " << joined(row.address, row.address + 1) << "; END_IF;\n";
  }
  return text.str();
}

std::string pair_declarations(const RegisterTable& table) {
  std::string text;
  for (const RegisterRow& row : table.measurements) {
    if (words_of(row.type) == 2) text += "  pair_" + std::to_string(row.address) + " : DWORD;\n";
  }
  return text;
}

std::string has_test_constant(const Dialect& dialect) {
  return std::string("(") + word(dialect, address_of("test_constant")) + " = WORD#" + hexadecimal(kTestConstant) + ")";
}

std::string word_order_check(const Dialect& dialect) {
  return std::string("  ") + dialect.target + "word_order_is_right := " + has_test_constant(dialect) + " AND (" +
         pair(dialect, row_named("test_constant_long")) + " = DWORD#" + hexadecimal(kLongTestConstant) + ");\n";
}

std::string range_of(int first, int count) {
  return std::to_string(first) + " to " + std::to_string(first + count - 1);
}

// Bit patterns become reals by arithmetic: DWORD_TO_REAL converts the number on some systems and copies the bits on
// others.
constexpr const char* kDecodeReal = R"(
(* The number that an IEEE 754 bit pattern stands for; not for NaN and infinity. *)
FUNCTION FC_FinsightReal : REAL
VAR_INPUT
  bits : DWORD;
END_VAR
VAR
  exponent : INT;
  fraction : REAL;
  power : REAL;
END_VAR
  exponent := DWORD_TO_INT(SHR(bits, 23) AND DWORD#16#FF);
  fraction := UDINT_TO_REAL(DWORD_TO_UDINT(bits AND DWORD#16#7FFFFF)) / 8388608.0;
  IF exponent = 0 THEN
    exponent := 1;  (* a subnormal number has no leading one *)
  ELSE
    fraction := fraction + 1.0;
  END_IF;
  power := 1.0;
  exponent := exponent - 127;
  WHILE exponent > 0 DO power := power * 2.0; exponent := exponent - 1; END_WHILE;
  WHILE exponent < 0 DO power := power / 2.0; exponent := exponent + 1; END_WHILE;
  FC_FinsightReal := fraction * power;
  IF (bits AND DWORD#16#80000000) <> DWORD#16#0 THEN FC_FinsightReal := -FC_FinsightReal; END_IF;
END_FUNCTION
)";

std::string command_block(const RegisterTable& table) {
  const std::string commands = values_text(table.control.front());
  return R"(
(* Carries out one command. On a rising edge of execute it sets write_request; while that is set, your Modbus client must
   write `request` to registers 1000 and 1001 (function 16). The command has ended when register 1002 shows its number.
   Within the 30 s before, write the device's key to register 1004. *)
FUNCTION_BLOCK FB_FinsightCommand
VAR_INPUT
  execute : BOOL;
  command : UINT;          (* )" +
         commands + R"( *)
  result_sequence : UINT;  (* register 1002, as read *)
  result : UINT;           (* register 1003, as read *)
  time_limit : TIME := T#5s;
END_VAR
VAR_OUTPUT
  request : ARRAY[0..1] OF WORD;
  write_request : BOOL;
  busy : BOOL;
  done : BOOL;
  error : BOOL;
  error_code : UINT;       (* as register 1003; 65535: no answer within time_limit *)
END_VAR
VAR
  before : BOOL;
  sequence : UINT;
  timer : TON;
END_VAR
  IF execute AND NOT before AND NOT busy THEN
    sequence := result_sequence + 1;
    IF sequence = 0 THEN sequence := 1; END_IF;
    request[0] := UINT_TO_WORD(command);
    request[1] := UINT_TO_WORD(sequence);
    busy := TRUE; write_request := TRUE;
    done := FALSE; error := FALSE; error_code := 0;
  END_IF;
  before := execute;
  timer(IN := busy, PT := time_limit);
  IF busy AND result_sequence = sequence THEN
    busy := FALSE;
    error_code := result;
    error := result <> 0;
    done := NOT error;
  ELSIF busy AND timer.Q THEN
    busy := FALSE; error := TRUE; error_code := 65535;
  END_IF;
  write_request := busy;
END_FUNCTION_BLOCK
)";
}

}  // namespace

std::string structured_text(const RegisterTable& table) {
  const Dialect& st = kStructuredText;
  const std::string heartbeat = word(st, address_of("heartbeat"));
  std::ostringstream text;
  text << "(* Finsight touch sensor: scaled values and commands, IEC 61131-3 Structured Text.\n   " << kOrigin
       << "\n   Read registers " << range_of(0, kMeasurementRegisters)
       << " with function 3 or 4 into `words`, then call FB_Finsight. *)\n"
       << kDecodeReal << "\nFUNCTION_BLOCK FB_Finsight\nVAR_INPUT\n  words : ARRAY[0.." << kMeasurementRegisters - 1
       << "] OF WORD;\n  low_word_first : BOOL;          (* as register 1019: TRUE for CDAB *)\n"
          "  stale_after : TIME := T#200ms;  (* time without a new heartbeat after which alive becomes FALSE *)\n"
          "END_VAR\nVAR_OUTPUT\n"
          "  alive : BOOL;  (* new results keep coming; while FALSE, use no value *)\n"
          "  word_order_is_right : BOOL;  (* by the test constants, registers 39 and 46 *)\n"
       << declarations(table, st, "  ") << "END_VAR\nVAR\n  last_heartbeat : WORD;\n  quiet : TON;\n"
       << pair_declarations(table) << "END_VAR\n"
       << "  quiet(IN := " << heartbeat << " = last_heartbeat, PT := stale_after);\n  last_heartbeat := " << heartbeat
       << ";\n  alive := NOT quiet.Q AND " << has_test_constant(st) << ";  (* the block has been read, and changes *)\n"
       << pair_assignments(table, st) << word_order_check(st) << assignments(table, st) << "END_FUNCTION_BLOCK\n"
       << command_block(table);
  return text.str();
}

std::string siemens_scl(const RegisterTable& table) {
  const std::string words = "Array[0.." + std::to_string(kMeasurementRegisters - 1) + "] of Word;";
  std::ostringstream text;
  text << "// Finsight touch sensor: data block and scaling for TIA Portal (S7-1200 and S7-1500).\n// " << kOrigin
       << "\n// Let MB_CLIENT read registers " << range_of(0, kMeasurementRegisters)
       << " (MB_DATA_ADDR 40001, MB_DATA_LEN " << kMeasurementRegisters
       << ") into \"Finsight\".words, then call\n// \"Finsight_Scale\".\n\n"
       << "TYPE \"Finsight_Values\"\nVERSION : 0.1\n  STRUCT\n"
          "    word_order_is_right : Bool;  // by the test constants, registers 39 and 46\n"
       << declarations(table, kScl, "    ") << "  END_STRUCT;\nEND_TYPE\n\n"
       << "DATA_BLOCK \"Finsight\"\n{ S7_Optimized_Access := 'FALSE' }\nVERSION : 0.1\nNON_RETAIN\n  STRUCT\n"
       << "    words : " << words << "  // registers " << range_of(0, kMeasurementRegisters)
       << "\n    control : Array[0.." << kControlRegisters - 1 << "] of Word;  // registers "
       << range_of(kControlAddress, kControlRegisters)
       << "\n    values : \"Finsight_Values\";\n  END_STRUCT;\nBEGIN\nEND_DATA_BLOCK\n\n"
       << "FUNCTION \"Finsight_Scale\" : Void\n{ S7_Optimized_Access := 'TRUE' }\nVERSION : 0.1\nVAR_INPUT\n"
          "  low_word_first : Bool;  // as register 1019: TRUE for CDAB\nEND_VAR\nVAR_IN_OUT\n"
       << "  words : " << words << "\n  values : \"Finsight_Values\";\nEND_VAR\nVAR_TEMP\n"
       << pair_declarations(table) << "END_VAR\nBEGIN\n"
       << pair_assignments(table, kScl) << word_order_check(kScl) << assignments(table, kScl) << "END_FUNCTION\n";
  return text.str();
}

}  // namespace finsight::host
