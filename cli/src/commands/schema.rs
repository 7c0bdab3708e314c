//! `hapfic schema`: layouts that other programs need.

use crate::cli::Language;
use hapfic_ipc::topic::{DOORBELLS, TOPICS};
use hapfic_messages::layout::{ENUMS, Field, Kind, MESSAGES, StructLayout, structs};
use serde_json::{Value, json};

/// Version of iceoryx2, whose files in shared memory this program shares with programs of the same version alone.
pub const TRANSPORT_VERSION: &str = "0.10.0";

/// The messages, codes, topics and doorbells in a language.
#[must_use]
pub fn messages(language: Language) -> String {
    match language {
        Language::Json => json_text(),
        Language::Python => python(),
        Language::C => c_header(),
    }
}

/// Name of a message on the wire, if the structure is one.
fn wire_name(layout: &StructLayout) -> Option<&'static str> {
    MESSAGES.iter().find(|message| *message.layout == *layout).map(|message| message.name)
}

/// Innermost type and the counts of the arrays around it, outermost first.
fn flat(kind: &Kind) -> (&Kind, Vec<usize>) {
    let (mut inner, mut counts) = (kind, Vec::new());
    while let Kind::Array(of, count) = inner {
        counts.push(*count);
        inner = of;
    }
    (inner, counts)
}

/// Documentation as one line. Units keep their brackets; links lose their targets.
fn line(doc: &str) -> String {
    let mut text = doc.split_whitespace().collect::<Vec<_>>().join(" ").replace('`', "");
    while let Some(begin) = text.find("](crate::") {
        let end = text[begin..].find(')').map_or(text.len(), |length| begin + length + 1);
        text.replace_range(begin + 1..end, "");
    }
    text
}

fn json_text() -> String {
    let kind = |kind: &Kind| match kind {
        Kind::Unsigned(bytes) => format!("uint{}", bytes * 8),
        Kind::Signed(bytes) => format!("int{}", bytes * 8),
        Kind::Float => "float64".to_owned(),
        Kind::Struct(layout) => layout.name.to_owned(),
        Kind::Array(..) => String::new(),
    };
    let field = |field: &Field| {
        let (inner, counts) = flat(&field.kind);
        json!({"name": field.name, "offset": field.offset, "size": field.kind.size(), "type": kind(inner), "shape": counts,
               "doc": field.doc.trim()})
    };
    let layouts: Vec<Value> = structs()
        .iter()
        .map(|layout| {
            json!({"name": layout.name, "wire_name": wire_name(layout), "size": layout.size, "alignment": layout.alignment,
                   "doc": layout.doc.trim(), "fields": layout.fields.iter().map(field).collect::<Vec<_>>()})
        })
        .collect();
    let enums: Vec<Value> = ENUMS
        .iter()
        .map(|codes| {
            let variants: Vec<Value> =
                codes.variants.iter().map(|(name, text, code)| json!({"name": name, "text": text, "code": code})).collect();
            json!({"name": codes.name, "variants": variants})
        })
        .collect();
    let topics: Vec<Value> = TOPICS
        .iter()
        .map(|topic| {
            json!({"name": topic.name, "message": topic.message, "doorbell": topic.doorbell, "history": topic.history,
                   "kept_realtime": topic.kept[0], "kept_lockstep": topic.kept[1]})
        })
        .collect();
    let doorbells: Value = DOORBELLS.iter().map(|(name, number)| ((*name).to_owned(), json!(number))).collect();
    let all = json!({"hapfic": env!("CARGO_PKG_VERSION"), "iceoryx2": TRANSPORT_VERSION, "structs": layouts, "enums": enums,
                     "topics": topics, "doorbells": doorbells});
    format!("{all:#}\n")
}

fn python() -> String {
    let scalar = |kind: &Kind| match kind {
        Kind::Unsigned(bytes) => format!("ctypes.c_uint{}", bytes * 8),
        Kind::Signed(bytes) => format!("ctypes.c_int{}", bytes * 8),
        Kind::Float => "ctypes.c_double".to_owned(),
        Kind::Struct(layout) => layout.name.to_owned(),
        Kind::Array(..) => String::new(),
    };
    let mut text = format!(
        "\"\"\"Messages of hapfic {version}: layouts, codes, topics. Printed by `hapfic schema --messages python`; do not edit.\n\n\
         Units are SI: m, rad, N, N m, s, unless a name states another.\"\"\"\n\nimport ctypes\nimport enum\n\n\
         VERSION = \"{version}\"\n#: Version of iceoryx2 whose shared memory these messages lie in.\n\
         TRANSPORT_VERSION = \"{TRANSPORT_VERSION}\"\n",
        version = env!("CARGO_PKG_VERSION")
    );
    for codes in ENUMS {
        text += &format!("\n\nclass {}(enum.IntEnum):\n", codes.name);
        for (name, _, code) in codes.variants {
            text += &format!("    {} = {code}\n", constant(name));
        }
    }
    for layout in structs() {
        text +=
            &format!("\n\nclass {}(ctypes.Structure):\n    \"\"\"{}\"\"\"\n\n    _fields_ = [\n", layout.name, line(layout.doc));
        for field in layout.fields {
            let (inner, counts) = flat(&field.kind);
            let kind = counts.iter().rev().fold(scalar(inner), |of, count| {
                if of.contains(' ') { format!("({of}) * {count}") } else { format!("{of} * {count}") }
            });
            text += &format!("        # {}\n        (\"{}\", {kind}),\n", line(field.doc), field.name);
        }
        text += "    ]\n";
        if let Some(name) = wire_name(layout) {
            text += &format!("\n    @staticmethod\n    def type_name() -> str:\n        return \"{name}\"\n");
        }
    }
    text += "\n\n#: Size in bytes of each structure, and offset of each of its fields.\nLAYOUTS = {\n";
    for layout in structs() {
        let offsets: Vec<String> = layout.fields.iter().map(|field| field.offset.to_string()).collect();
        text += &format!("    {}: ({}, [{}]),\n", layout.name, layout.size, offsets.join(", "));
    }
    text += "}\n\n\n#: Topics: message, number of the doorbell, history, messages of each sender that outlive it (realtime, lockstep).\n\
             TOPICS = {\n";
    for topic in TOPICS {
        let message = MESSAGES.iter().find(|message| message.name == topic.message).map_or("None", |m| m.layout.name);
        let doorbell = topic.doorbell.map_or("None".to_owned(), |number| number.to_string());
        let [realtime, lockstep] = topic.kept;
        text += &format!("    \"{}\": ({message}, {doorbell}, {}, ({realtime}, {lockstep})),\n", topic.name, topic.history);
    }
    text += "}\n\n#: Doorbells without a topic.\nDOORBELLS = {\n";
    for (name, number) in DOORBELLS {
        text += &format!("    \"{name}\": {number},\n");
    }
    text + "}\n"
}

/// `EmergencyStop` as `EMERGENCY_STOP`.
fn constant(name: &str) -> String {
    let mut text = String::new();
    for c in name.chars() {
        if c.is_uppercase() && !text.is_empty() {
            text.push('_');
        }
        text.extend(c.to_uppercase());
    }
    // `None` is no name in Python and none in C.
    if text == "NONE" { "NO".to_owned() } else { text }
}

fn c_header() -> String {
    let scalar = |kind: &Kind| match kind {
        Kind::Unsigned(bytes) => format!("uint{}_t", bytes * 8),
        Kind::Signed(bytes) => format!("int{}_t", bytes * 8),
        Kind::Float => "double".to_owned(),
        Kind::Struct(layout) => format!("hapfic_{}", layout.name),
        Kind::Array(..) => String::new(),
    };
    let mut text = format!(
        "/* Messages of hapfic {version}: layouts and codes. Printed by `hapfic schema --messages c`; do not edit.\n\
         \x20  Units are SI: m, rad, N, N m, s, unless a name states another. */\n\
         #ifndef HAPFIC_MESSAGES_H\n#define HAPFIC_MESSAGES_H\n\n#include <assert.h>\n#include <stddef.h>\n#include <stdint.h>\n\n\
         #define HAPFIC_VERSION \"{version}\"\n#define HAPFIC_TRANSPORT_VERSION \"{TRANSPORT_VERSION}\"\n",
        version = env!("CARGO_PKG_VERSION")
    );
    for codes in ENUMS {
        text += &format!("\nenum hapfic_{} {{\n", codes.name);
        for (name, _, code) in codes.variants {
            text += &format!("    HAPFIC_{}_{} = {code},\n", constant(codes.name), constant(name));
        }
        text += "};\n";
    }
    for layout in structs() {
        text += &format!("\n/* {} */\ntypedef struct {{\n", line(layout.doc));
        for field in layout.fields {
            let (inner, counts) = flat(&field.kind);
            let shape: String = counts.iter().map(|count| format!("[{count}]")).collect();
            text += &format!("    /* {} */\n    {} {}{shape};\n", line(field.doc), scalar(inner), field.name);
        }
        text += &format!("}} hapfic_{};\n", layout.name);
        text += &format!("static_assert(sizeof(hapfic_{0}) == {1}, \"size of {0}\");\n", layout.name, layout.size);
        for field in layout.fields {
            text += &format!(
                "static_assert(offsetof(hapfic_{0}, {1}) == {2}, \"offset of {0}.{1}\");\n",
                layout.name, field.name, field.offset
            );
        }
        if let Some(name) = wire_name(layout) {
            text += &format!("#define HAPFIC_{}_NAME \"{name}\"\n", constant(layout.name));
        }
    }
    text += "\n/* Topics, and the number of the doorbell that sending notifies. */\n";
    for topic in TOPICS {
        let name = topic.name.replace('/', "_").to_uppercase();
        text += &format!("#define HAPFIC_TOPIC_{name} \"{}\"\n", topic.name);
        if let Some(number) = topic.doorbell {
            text += &format!("#define HAPFIC_DOORBELL_{name} {number}\n");
        }
    }
    for (name, number) in DOORBELLS {
        text += &format!("#define HAPFIC_DOORBELL_{name} {number}\n");
    }
    text + "\n#endif\n"
}
