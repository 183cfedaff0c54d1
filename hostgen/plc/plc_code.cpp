// The register table as a PLC's source code: Structured Text and Siemens SCL.
#include <span>
#include <sstream>

#include "hostgen/plc/dialect.h"
#include "hostgen/plc/plc_files.h"
#include "hostgen/plc/row_text.h"

namespace finsight::host {

namespace {

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

std::string alive(const Dialect& dialect) { return std::string(dialect.target) + "alive"; }

std::string bit_assignments(const Dialect& dialect, const RegisterRow& row) {
  std::string text;
  for (const NamedValue& bit : row.values) {
    text += std::string("  ") + dialect.target + variable_of(row, bit) + " := " + alive(dialect) + " AND ((" +
            word(dialect, row.address) + " AND WORD#" + hexadecimal(1U << bit.value) + ") <> WORD#16#0);\n";
  }
  return text;
}

/// Assignments of all values. While not alive none is valid and no bit is set, except that there is a fault. An invalid
/// value becomes 0.
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
      text << "  " << valid << " := " << alive(dialect) << " AND (" << validity(dialect, row) << ");\n"
           << "  IF " << valid << " THEN " << variable << " := " << value << "; ELSE " << variable
           << " := " << (type_of(row) == "REAL" ? "0.0" : "0") << "; END_IF;\n";
    } else {
      text << "  " << variable << " := " << value << ";\n";
    }
  }
  text << "  IF NOT " << alive(dialect) << " THEN " << dialect.target << "any_fault := TRUE; END_IF;\n";
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
  IF (bits AND DWORD#16#80000000) <> DWORD#16#0 THEN power := -power; END_IF;
  FC_FinsightReal := fraction * power;
END_FUNCTION
)";

/// `alive`: whether the block was read, has been read again since, and was young when it was read.
std::string alive_check(const Dialect& dialect) {
  const auto local = [&](const char* name) { return std::string(dialect.local) + name; };
  const std::string heartbeat = word(dialect, address_of("heartbeat")), age = word(dialect, address_of("age"));
  const std::string fault = word(dialect, address_of("fault"));
  return "  " + local("quiet(IN := ") + heartbeat + " = " + local("last_heartbeat") +
         ", PT := " + local("poll_period") + " + " + local("poll_period") + " + T#200ms);\n  " +
         local("last_heartbeat") + " := " + heartbeat + ";\n  " + alive(dialect) + " := NOT " + local("quiet.Q") +
         " AND " + has_test_constant(dialect) + " AND (WORD_TO_UINT(" + age + ") <= " + local("max_age") +
         ") AND (WORD_TO_UINT(" + fault + ") <> " + std::to_string(value_named("fault", "stalled")) + ");\n";
}

constexpr const char* kAliveInputs[][3] = {
    {"low_word_first : BOOL;", "", "as register 1019: TRUE for CDAB"},
    {"poll_period : TIME := T#100ms;", "",
     "how often the words are read; without a new heartbeat for twice as long and 200 ms, not alive"},
    {"max_age : UINT := 3000;", "", "0.1 ms; results that were older than this when they were read are not used"},
};

std::string alive_inputs(const Dialect& dialect) {
  std::string text;
  for (const auto& input : kAliveInputs) {
    text += std::string("  ") + input[0] + "  " + dialect.comment_begin + input[2] + dialect.comment_end + "\n";
  }
  return text;
}

/// What a command's block declares: name and type, and what it is for.
struct Variable {
  const char* declaration;
  const char* what;
};
constexpr Variable kCommandInputs[] = {
    {"execute : BOOL;", "a rising edge starts the command"},
    {"command : UINT;", nullptr},  // its codes come from the table
    {"own_sequence : UINT;", "register 1201, as read"},
    {"own_command : UINT;", "register 1202, as read"},
    {"own_result : UINT;", "register 1203, as read"},
    {"link_ready : BOOL;", "they have been read since the connection was opened"},
    {"write_exception : UINT;", "code of the exception that the write got, for one call; 0: none"},
    {"first_number : UINT := 1;", "give every PLC or other client of the device numbers of its own, 2000 or more ..."},
    {"last_number : UINT := 65535;", "... then none is refused because it was used"},
    {"time_limit : TIME := T#10s;", "for all of it"},
};
constexpr Variable kCommandShared[] = {
    {"number : UINT;", "the newest number of this PLC: one variable, the same for all command blocks of the device"},
    {"in_turn : BOOL;",
     "TRUE while one of them is busy and the others wait: one variable for all of them, too; not retentive"},
};
constexpr Variable kCommandOutputs[] = {
    {"request : $REQUEST;", "write it to registers 1000 and 1001 in one request ..."},
    {"write_request : BOOL;", "... while this is TRUE"},
    {"busy : BOOL;", "until done or error"},
    {"done : BOOL;", "the command ran, with result 0"},
    {"error : BOOL;", "it did not"},
    {"error_code : UINT;", "as register 1203; 65535: no result within time_limit"},
};

std::string variables(const Dialect& dialect, std::span<const Variable> list, const std::string& request,
                      const std::string& commands) {
  std::string text;
  for (const Variable& variable : list) {
    std::string declaration = variable.declaration;
    if (const auto at = declaration.find("$REQUEST"); at != std::string::npos) declaration.replace(at, 8, request);
    text += "  " + declaration + "  " + dialect.comment_begin + (variable.what ? variable.what : commands) +
            dialect.comment_end + "\n";
  }
  return text;
}

// # stands for the prefix of local variables. A number that another client has used is exception 3: then the next one
// is tried. The result counts only with the block's own number and command, which nobody else's command can show.
constexpr const char* kCommandBody = R"(  IF #execute AND NOT #before AND NOT #busy THEN
    #given := #command;
    #chosen := FALSE;
    #busy := TRUE; #done := FALSE; #error := FALSE; #error_code := 0;
    #timer(IN := FALSE, PT := #time_limit);
  END_IF;
  #before := #execute;
  #is_new := #busy AND #link_ready AND ((NOT #chosen AND NOT #in_turn) OR (#chosen AND #write_exception = 3));
  IF #is_new THEN
    IF #number = 0 THEN #number := #own_sequence; END_IF;
    IF #number < #first_number OR #number >= #last_number THEN #number := #first_number;
    ELSE #number := #number + 1; END_IF;
    #sequence := #number;
    #in_turn := TRUE;
    #request[0] := UINT_TO_WORD(#given);
    #request[1] := UINT_TO_WORD(#sequence);
    #chosen := TRUE;
  END_IF;
  #timer(IN := #busy, PT := #time_limit);
  #taken := #busy AND #chosen AND NOT #is_new AND #own_sequence = #sequence AND #own_command = #given;
  IF #taken AND #own_result <> $RUNNING THEN
    #busy := FALSE;
    #error_code := #own_result;
    #error := #own_result <> 0;
    #done := NOT #error;
  ELSIF #busy AND #timer.Q THEN
    #busy := FALSE; #error := TRUE; #error_code := 65535;
  END_IF;
  IF #chosen AND NOT #busy THEN #chosen := FALSE; #in_turn := FALSE; END_IF;
  #write_request := #busy AND #chosen AND #link_ready AND NOT #taken;
)";

std::string command_body(const Dialect& dialect) {
  std::string text;
  for (const char* c = kCommandBody; *c; ++c) {
    *c == '#' ? text += dialect.local : text += *c;
  }
  const std::string running = "$RUNNING";
  return text.replace(text.find(running), running.size(), std::to_string(value_named("own_result", "running")));
}

std::string command_block(const RegisterTable& table) {
  const Dialect& st = kStructuredText;
  const std::string commands = values_text(table.control.front());
  return R"(
(* Carries out one command. Read registers 1200 to 1203 all the time and give the last three to the block; while
   write_request is TRUE, write `request` to registers 1000 and 1001 in one request (function 16), again and again if it
   is refused as busy. Before it, write the device's key to register 1004. Other clients' commands do no harm. Several
   blocks in one PLC take turns: call all of them in every cycle. *)
FUNCTION_BLOCK FB_FinsightCommand
VAR_INPUT
)" + variables(st, kCommandInputs, "FinsightRequest", commands) +
         "END_VAR\nVAR_IN_OUT\n" + variables(st, kCommandShared, "FinsightRequest", commands) +
         "END_VAR\nVAR_OUTPUT\n" + variables(st, kCommandOutputs, "FinsightRequest", commands) + R"(END_VAR
VAR
  before : BOOL;
  chosen : BOOL;
  is_new : BOOL;
  taken : BOOL;
  given : UINT;
  sequence : UINT;
  timer : TON;
END_VAR
)" + command_body(st) +
         "END_FUNCTION_BLOCK\n";
}

std::string scl_command_block(const RegisterTable& table) {
  const std::string commands = values_text(table.control.front());
  return R"(
// Carries out one command. Let MB_CLIENT read registers 1200 to 1203 all the time (MB_MODE 0, MB_DATA_ADDR 41201,
// MB_DATA_LEN 4), and while write_request is TRUE write `request` (MB_MODE 1, MB_DATA_ADDR 41001, MB_DATA_LEN 2).
FUNCTION_BLOCK "Finsight_Command"
{ S7_Optimized_Access := 'FALSE' }
VERSION : 0.1
VAR_INPUT
)" + variables(kScl, kCommandInputs, "Array[0..1] of Word", commands) +
         "END_VAR\nVAR_IN_OUT\n" + variables(kScl, kCommandShared, "Array[0..1] of Word", commands) +
         "END_VAR\nVAR_OUTPUT\n" + variables(kScl, kCommandOutputs, "Array[0..1] of Word", commands) + R"(END_VAR
VAR
  before : Bool;
  chosen : Bool;
  given : UInt;
  sequence : UInt;
  timer {InstructionName := 'TON_TIME'; LibVersion := '1.0'} : TON_TIME;
END_VAR
VAR_TEMP
  is_new : Bool;
  taken : Bool;
END_VAR
BEGIN
)" + command_body(kScl) +
         "END_FUNCTION_BLOCK\n";
}

// What an S7-1200 or S7-1500 calls in OB1. One MB_CLIENT does one thing at a time, so the steps take turns.
constexpr const char* kSclExample = R"(
// An example of both blocks with one connection of MB_CLIENT (library MODBUS (TCP) V4 or later). Set the device's address
// in "Finsight".connection before the first call, and call this block in every cycle.
FUNCTION_BLOCK "Finsight_Example"
{ S7_Optimized_Access := 'FALSE' }
VERSION : 0.1
VAR_INPUT
  execute : Bool;  // a rising edge starts `command`
  command : UInt;
  key : Word := W#16#4653;  // 18003, the device's key
END_VAR
VAR_OUTPUT
  alive : Bool;
  done : Bool;
  error : Bool;
END_VAR
VAR
  client {InstructionName := 'MB_CLIENT'; LibVersion := '5.2'} : MB_CLIENT;
  finger : "Finsight_FB";
  order : "Finsight_Command";
  step : Int;  // 0 read the measurements, 1 read the result of our command, 2 unlock, 3 write the command
  has_read : Bool;
  refused : UInt;
END_VAR
BEGIN
  CASE #step OF
    0: #client(REQ := TRUE, DISCONNECT := FALSE, MB_MODE := 0, MB_DATA_ADDR := 40001, MB_DATA_LEN := $MEASUREMENTS,
               MB_DATA_PTR := "Finsight".words, CONNECT := "Finsight".connection);
    1: #client(REQ := TRUE, DISCONNECT := FALSE, MB_MODE := 0, MB_DATA_ADDR := 41201, MB_DATA_LEN := 4,
               MB_DATA_PTR := "Finsight".own, CONNECT := "Finsight".connection);
    2: "Finsight".key[0] := #key;
       #client(REQ := TRUE, DISCONNECT := FALSE, MB_MODE := 2, MB_DATA_ADDR := 41005, MB_DATA_LEN := 1,
               MB_DATA_PTR := "Finsight".key, CONNECT := "Finsight".connection);
    3: #client(REQ := TRUE, DISCONNECT := FALSE, MB_MODE := 2, MB_DATA_ADDR := 41001, MB_DATA_LEN := 2,
               MB_DATA_PTR := "Finsight".request, CONNECT := "Finsight".connection);
  END_CASE;
  #refused := 0;
  IF #step = 3 AND #client.ERROR AND #client.STATUS = W#16#8384 THEN #refused := 3; END_IF;  // exception 3
  IF #step = 1 AND #client.DONE THEN #has_read := TRUE; END_IF;
  IF #step < 2 AND #client.ERROR THEN #has_read := FALSE; END_IF;
  IF #client.DONE OR #client.ERROR THEN
    #step := #step + 1;
    IF #step > 3 OR (#step > 1 AND NOT #order.write_request) THEN #step := 0; END_IF;
  END_IF;
  #finger(low_word_first := FALSE, words := "Finsight".words, values := "Finsight".values);
  #order(execute := #execute, command := #command, own_sequence := WORD_TO_UINT("Finsight".own[1]),
         own_command := WORD_TO_UINT("Finsight".own[2]), own_result := WORD_TO_UINT("Finsight".own[3]),
         link_ready := #has_read, write_exception := #refused, number := "Finsight".number,
         in_turn := "Finsight".in_turn);
  "Finsight".request := #order.request;
  #alive := "Finsight".values.alive;
  #done := #order.done;
  #error := #order.error;
END_FUNCTION_BLOCK
)";

}  // namespace

std::string structured_text(const RegisterTable& table) {
  const Dialect& st = kStructuredText;
  std::ostringstream text;
  text
      << "(* Finsight touch sensor: scaled values and commands, IEC 61131-3 Structured Text.\n   " << kOrigin
      << "\n   Read registers " << range_of(0, kMeasurementRegisters)
      << " with function 3 or 4 into a variable of type FinsightWords, then call FB_Finsight. *)\n\n"
      << "TYPE\n  FinsightWords : ARRAY [0.." << kMeasurementRegisters - 1
      << "] OF WORD;\n  FinsightGripperWords : ARRAY [0.." << kGatheredRegisters - 1
      << "] OF WORD;\n  FinsightRequest : ARRAY [0..1] OF WORD;\nEND_TYPE\n"
      << kDecodeReal
      << "\n(* Call it after every read, or in every cycle. It may be called as slowly as you like: alive becomes "
         "FALSE at the\n"
         "   first call after two poll_periods and 200 ms without a new heartbeat, and at once when the device says "
         "that it is\n   stalled (fault 8).\n"
         "   While alive is FALSE no value is valid, no bit is TRUE except any_fault, and all values are 0 or old. *)\n"
      << "FUNCTION_BLOCK FB_Finsight\nVAR_INPUT\n  words : FinsightWords;\n"
      << alive_inputs(st) << "END_VAR\nVAR_OUTPUT\n"
      << "  alive : BOOL;  (* new results keep coming; while FALSE, use no value *)\n"
         "  word_order_is_right : BOOL;  (* by the test constants, registers 39 and 46 *)\n"
      << declarations(table, st, "  ") << "END_VAR\nVAR\n  last_heartbeat : WORD;\n  quiet : TON;\n"
      << pair_declarations(table) << "END_VAR\n"
      << alive_check(st) << pair_assignments(table, st) << word_order_check(st) << assignments(table, st)
      << "END_FUNCTION_BLOCK\n"
      << command_block(table) << gripper_structured_text(table);
  return text.str();
}

std::string siemens_scl(const RegisterTable& table) {
  const std::string words = "Array[0.." + std::to_string(kMeasurementRegisters - 1) + "] of Word;";
  std::string example = kSclExample;
  const std::string quantity = "$MEASUREMENTS";
  example.replace(example.find(quantity), quantity.size(), std::to_string(kMeasurementRegisters));
  std::ostringstream text;
  text << "// Finsight touch sensor: data block, scaling and commands for TIA Portal (S7-1200 and S7-1500).\n// "
       << kOrigin << "\n// Let MB_CLIENT read registers " << range_of(0, kMeasurementRegisters)
       << " (MB_DATA_ADDR 40001, MB_DATA_LEN " << kMeasurementRegisters
       << ") into \"Finsight\".words, then call\n// \"Finsight_FB\". \"Finsight_Example\" at the end shows all of "
          "it.\n\n"
       << "TYPE \"Finsight_Values\"\nVERSION : 0.1\n  STRUCT\n"
          "    alive : Bool;  // new results keep coming; while FALSE, use no value\n"
          "    word_order_is_right : Bool;  // by the test constants, registers 39 and 46\n"
       << declarations(table, kScl, "    ") << "  END_STRUCT;\nEND_TYPE\n\n"
       << "DATA_BLOCK \"Finsight\"\n{ S7_Optimized_Access := 'FALSE' }\nVERSION : 0.1\nNON_RETAIN\n  STRUCT\n"
       << "    words : " << words << "  // registers " << range_of(0, kMeasurementRegisters)
       << "\n    own : Array[0..3] of Word;  // registers 1200 to 1203\n"
          "    request : Array[0..1] of Word;  // for registers 1000 and 1001\n"
          "    key : Array[0..0] of Word;  // for register 1004\n"
          "    number : UInt;  // of the newest command\n"
          "    in_turn : Bool;  // while a command block is busy\n"
          "    connection : TCON_IP_v4;\n"
          "    values : \"Finsight_Values\";\n  END_STRUCT;\nBEGIN\n"
          "  connection.InterfaceId := 64;  // the processor's own PROFINET port\n"
          "  connection.ID := 1;\n  connection.ConnectionType := B#16#0B;  // TCP\n"
          "  connection.ActiveEstablished := TRUE;\n"
          "  connection.RemoteAddress.ADDR[1] := 192;\n  connection.RemoteAddress.ADDR[2] := 168;\n"
          "  connection.RemoteAddress.ADDR[3] := 1;\n  connection.RemoteAddress.ADDR[4] := 50;\n"
          "  connection.RemotePort := 502;\nEND_DATA_BLOCK\n\n"
       << "FUNCTION_BLOCK \"Finsight_FB\"\n{ S7_Optimized_Access := 'FALSE' }\nVERSION : 0.1\nVAR_INPUT\n"
       << alive_inputs(kScl) << "END_VAR\nVAR_IN_OUT\n"
       << "  words : " << words << "\n  values : \"Finsight_Values\";\nEND_VAR\nVAR\n  last_heartbeat : Word;\n"
       << "  quiet {InstructionName := 'TON_TIME'; LibVersion := '1.0'} : TON_TIME;\nEND_VAR\nVAR_TEMP\n"
       << pair_declarations(table) << "END_VAR\nBEGIN\n"
       << alive_check(kScl) << pair_assignments(table, kScl) << word_order_check(kScl) << assignments(table, kScl)
       << "END_FUNCTION_BLOCK\n"
       << scl_command_block(table) << gripper_scl(table) << example;
  return text.str();
}

}  // namespace finsight::host
