//! Agreement of docs/messages.md with proto/hapfic.proto. `HAPFIC_WRITE_DOCS=1` writes the page.

use hapfic_log::Topic;
use prost_types::field_descriptor_proto::{Label, Type};
use prost_types::{DescriptorProto, FieldDescriptorProto, FileDescriptorProto};
use std::collections::HashMap;
use std::fmt::Write as _;

const PAGE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/messages.md");

/// Comments by the path of their element in the file descriptor.
type Comments = HashMap<Vec<i32>, String>;

fn schema() -> (FileDescriptorProto, Comments) {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/proto");
    let mut set = protox::compile(["hapfic.proto"], [folder]).unwrap();
    let file = set.file.remove(0);
    let locations = file.source_code_info.clone().unwrap_or_default().location;
    let comment = |text: String| text.split_whitespace().collect::<Vec<_>>().join(" ");
    let comments = locations.into_iter().filter_map(|l| Some((l.path.clone(), comment(l.leading_comments?)))).collect();
    (file, comments)
}

fn comment<'a>(comments: &'a Comments, path: &[i32], name: &str) -> &'a str {
    comments.get(path).unwrap_or_else(|| panic!("hapfic.proto: {name} has no comment, expected its meaning"))
}

fn type_name(field: &FieldDescriptorProto) -> String {
    let name = match field.r#type() {
        Type::Double => "double".to_owned(),
        Type::Int64 => "int64".to_owned(),
        Type::Uint64 => "uint64".to_owned(),
        Type::Uint32 => "uint32".to_owned(),
        Type::Bool => "bool".to_owned(),
        Type::String => "string".to_owned(),
        Type::Message => {
            let name = field.type_name().trim_start_matches(".hapfic.");
            format!("[{name}](#{})", name.to_lowercase())
        }
        other => panic!("hapfic.proto: {} has type {other:?}, expected a type with a name on the page", field.name()),
    };
    if field.label() == Label::Repeated { format!("list of {name}") } else { name }
}

/// Takes the unit in brackets and the frame out of a comment: meaning, unit, frame.
fn parts(comment: &str) -> (String, String, String) {
    let (mut text, mut unit, mut frame) = (comment.to_owned(), String::new(), String::new());
    if let (Some(from), Some(to)) = (text.find(" ["), text.find(']')) {
        text[from + 2..to].clone_into(&mut unit);
        text.replace_range(from..=to, "");
    }
    if let Some(at) = text.find(", world frame") {
        "world".clone_into(&mut frame);
        text.replace_range(at..at + ", world frame".len(), "");
    }
    (text, unit, frame)
}

fn table(page: &mut String, message: &DescriptorProto, index: i32, comments: &Comments) {
    page.push_str("\n| field | type | unit | frame | meaning |\n|---|---|---|---|---|\n");
    for (i, field) in message.field.iter().enumerate() {
        let (meaning, unit, frame) = parts(comment(comments, &[4, index, 2, i as i32], field.name()));
        writeln!(page, "| `{}` | {} | {unit} | {frame} | {meaning} |", field.name(), type_name(field)).unwrap();
    }
}

fn wrapped(text: &str) -> String {
    let (mut lines, mut line) = (String::new(), String::new());
    for word in text.split(' ') {
        if !line.is_empty() && line.len() + 1 + word.len() > 120 {
            lines += &line;
            lines.push('\n');
            line.clear();
        }
        if !line.is_empty() {
            line.push(' ');
        }
        line += word;
    }
    lines + &line + "\n"
}

fn page() -> String {
    let (file, comments) = schema();
    let mut page = "# Messages\n\n".to_owned();
    page += &wrapped(
        "Every topic of a log, with the fields of its messages. The page is generated from the comments of \
         `libs/log/proto/hapfic.proto`; the schema itself is in every log, so that a reader needs no file of this project. \
         Vectors of three numbers are x, y and z; lists over the joints go from the base to the foot. The z axis of the world \
         frame points up, and forces are those of the environment on the foot unless a field says otherwise.",
    );
    page += "\n| topic | message |\n|---|---|\n";
    for topic in Topic::ALL {
        let name = topic.schema_name();
        let link = match name.strip_prefix("hapfic.") {
            Some(own) => format!("[{name}](#{})", own.to_lowercase()),
            None => format!("[{name}](https://docs.foxglove.dev/docs/sdk/schemas), for viewers"),
        };
        writeln!(page, "| `{}` | {link} |", topic.name()).unwrap();
    }
    for (i, message) in file.message_type.iter().enumerate() {
        let about = comment(&comments, &[4, i as i32], message.name());
        write!(page, "\n## {}\n\n{}", message.name(), wrapped(about)).unwrap();
        table(&mut page, message, i as i32, &comments);
    }
    page
}

#[test]
fn messages_page_equals_schema() {
    let expected = page();
    if std::env::var_os("HAPFIC_WRITE_DOCS").is_some() {
        std::fs::write(PAGE, &expected).unwrap();
    }
    let found = std::fs::read_to_string(PAGE).unwrap_or_default();
    assert!(
        found == expected,
        "docs/messages.md differs from hapfic.proto. Hint: HAPFIC_WRITE_DOCS=1 cargo test -p hapfic-log messages_page"
    );
}

#[test]
fn vectors_have_unit_and_frame() {
    let (file, comments) = schema();
    let spatial = ["position", "velocity", "force", "error", "offset", "x_max", "point", "target_position", "stiffness"];
    for (i, message) in file.message_type.iter().enumerate() {
        for (j, field) in message.field.iter().enumerate() {
            let (_, unit, frame) = parts(comment(&comments, &[4, i as i32, 2, j as i32], field.name()));
            let place = format!("{}.{}: {}", message.name(), field.name(), type_name(field));
            assert!(field.r#type() != Type::Double || !unit.is_empty() || field.name().ends_with("_j"), "{place} has no unit");
            if field.label() == Label::Repeated && spatial.contains(&field.name()) {
                assert_eq!(frame, "world", "{place} has no frame");
            }
        }
    }
}
