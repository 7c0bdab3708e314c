//! Copy of records from the original to the new log.

use super::bytes::FieldReader;
use super::error::RecoverError;
use super::found::Recovery;
use super::output::{PROTOBUF, RecoveryWriter};
use super::plausibility::{Plausibility, PlausibilityCheck};
use super::records::MessageRecord;
use crate::parts::{PART, RUN};
use crate::topic::Topic;
use mcap::records::{self, MessageHeader, Metadata, op};
use std::collections::BTreeMap;

/// Copies valid records to the new log.
pub(super) struct Copier {
    /// `None` if the original is complete.
    output: Option<RecoveryWriter>,
    schemas: BTreeMap<u16, CopiedSchema>,
    channels: BTreeMap<u16, CopiedChannel>,
    /// Whether the new log has a channel for every topic.
    numbered: bool,
    plausibility: PlausibilityCheck,
    /// Findings so far.
    pub(super) found: Recovery,
}

struct CopiedSchema {
    name: String,
    encoding: String,
    data: Vec<u8>,
}

struct CopiedChannel {
    name: String,
    /// `None` for a topic of another program.
    topic: Option<Topic>,
    /// Number in the new log.
    number: u16,
    /// Whether the channel is from a chunk with a right checksum.
    checked: bool,
}

/// Result of copying a chunk.
pub(super) struct CopiedChunk {
    /// Messages kept.
    pub(super) messages: u64,
    /// First and last number of those messages: their ticks, cut to 32 bits.
    pub(super) ticks: Option<(u32, u32)>,
    /// Cause of an end before that of the chunk.
    pub(super) stopped: Option<String>,
}

impl Copier {
    pub(super) fn new(output: Option<RecoveryWriter>) -> Self {
        Self {
            output,
            schemas: BTreeMap::new(),
            channels: BTreeMap::new(),
            numbered: false,
            plausibility: PlausibilityCheck::default(),
            found: Recovery::default(),
        }
    }

    pub(super) fn into_parts(self) -> (Option<RecoveryWriter>, Recovery) {
        (self.output, self.found)
    }

    pub(super) fn attachment(&mut self, attachment: &mcap::Attachment<'_>) -> Result<(), RecoverError> {
        if let Some(output) = &mut self.output {
            output.attach(attachment)?;
        }
        self.found.attachments.push(attachment.name.clone());
        Ok(())
    }

    pub(super) fn metadata(&mut self, metadata: &Metadata) -> Result<(), RecoverError> {
        if let Some(output) = &mut self.output {
            output.metadata(metadata)?;
        }
        if metadata.name == RUN && metadata.metadata.get(PART).is_some_and(|number| number != "1") {
            self.found.states.later_part = true;
            self.found.commands.later_part = true;
        }
        self.found.metadata.push(metadata.name.clone());
        Ok(())
    }

    /// Copies the records of a chunk, uncompressed; `checked` if its checksum is right.
    pub(super) fn chunk(&mut self, records: &[u8], checked: bool) -> Result<CopiedChunk, RecoverError> {
        self.plausibility.begin();
        let mut copied = CopiedChunk { messages: 0, ticks: None, stopped: None };
        let mut fields = FieldReader::new(records);
        while !fields.is_empty() {
            let record = fields.record();
            let stopped = match record {
                None => Err("a record runs over the end of the readable bytes".to_owned()),
                Some((op::SCHEMA, body)) if checked => self.schema(body),
                Some((op::CHANNEL, body)) if checked => self.channel(body)?,
                // Not trusted: the writer's numbers are known.
                Some((op::SCHEMA | op::CHANNEL, _)) => Ok(()),
                Some((op::MESSAGE, body)) => match self.message(body, checked)? {
                    Ok(None) => Ok(()),
                    Ok(Some(sequence)) => {
                        copied.messages += 1;
                        copied.ticks = Some((copied.ticks.map_or(sequence, |(first, _)| first), sequence));
                        Ok(())
                    }
                    Err(what) => Err(what),
                },
                // Extensions of other tools.
                Some(_) if checked => Ok(()),
                Some((opcode, _)) => Err(format!("found opcode {opcode:#04x}, expected a message")),
            };
            match stopped {
                Ok(()) => {}
                // A record under a right checksum locates the next one.
                Err(what) if checked && record.is_some() => copied.stopped = Some(what),
                Err(what) => {
                    copied.stopped = Some(what);
                    break;
                }
            }
        }
        if !checked {
            self.found.unchecked += copied.messages;
        }
        Ok(copied)
    }

    fn schema(&mut self, body: &[u8]) -> Result<(), String> {
        match crate::lengths::parse(op::SCHEMA, body) {
            Ok(records::Record::Schema { header, data }) => {
                let schema = CopiedSchema { name: header.name, encoding: header.encoding, data: data.into_owned() };
                self.schemas.insert(header.id, schema);
                Ok(())
            }
            _ => Err("a schema cannot be read".to_owned()),
        }
    }

    /// Copies a channel of a chunk with a right checksum.
    fn channel(&mut self, body: &[u8]) -> Result<Result<(), String>, RecoverError> {
        let Ok(records::Record::Channel(channel)) = crate::lengths::parse(op::CHANNEL, body) else {
            return Ok(Err("a channel cannot be read".to_owned()));
        };
        let known = Topic::from_name(&channel.topic);
        let Some(schema) = self.schemas.get(&channel.schema_id) else {
            if let Some(topic) = known {
                self.rebuild(channel.id, topic)?;
                return Ok(Ok(()));
            }
            return Ok(Err(format!("topic {:?} is unknown, and its schema is lost", channel.topic)));
        };
        let number = match &mut self.output {
            None => 0,
            Some(output) => {
                let schema = (schema.name.as_str(), schema.encoding.as_str(), schema.data.as_slice());
                output.channel(&channel.topic, &channel.message_encoding, &channel.metadata, Some(schema))?
            }
        };
        let topic = known.filter(|topic| topic.schema_name() == schema.name && channel.message_encoding == PROTOBUF);
        self.channels.insert(channel.id, CopiedChannel { name: channel.topic, topic, number, checked: true });
        Ok(Ok(()))
    }

    /// Gives a channel the schema of this program.
    fn rebuild(&mut self, id: u16, topic: Topic) -> Result<(), RecoverError> {
        let number = match &mut self.output {
            None => 0,
            Some(output) => {
                // Adds all missing channels in the writer's order, so that each keeps its number.
                if !self.numbered {
                    let present = |topic: Topic| self.channels.values().any(|channel| channel.name == topic.name());
                    for missing in Topic::ALL.into_iter().filter(|&topic| !present(topic)) {
                        output.own_channel(missing)?;
                    }
                    self.numbered = true;
                }
                output.own_channel(topic)?
            }
        };
        self.found.rebuilt.insert(topic.name().to_owned());
        let channel = CopiedChannel { name: topic.name().to_owned(), topic: Some(topic), number, checked: false };
        self.channels.insert(id, channel);
        Ok(())
    }

    /// Copies a message. Returns its number, `None` for a repeated message, or the reason for a rejection.
    fn message(&mut self, body: &[u8], checked: bool) -> Result<Result<Option<u32>, String>, RecoverError> {
        let Some(message) = MessageRecord::parse(body) else { return Ok(Err("a message is too short".to_owned())) };
        let id = message.channel;
        if !self.channels.contains_key(&id) {
            // The writer numbers its topics from 1 on, always in this order.
            let topic = id.checked_sub(1).and_then(|index| Topic::ALL.get(usize::from(index)).copied());
            let Some(topic) = topic else { return Ok(Err(format!("a message has channel {id}, which is lost"))) };
            if self.plausibility.check(topic, &message, checked) != Plausibility::Valid {
                return Ok(Err(format!("a message of channel {id}, which is lost, is not one of {}", topic.name())));
            }
            self.rebuild(id, topic)?;
        } else if let Some(channel) = self.channels.get(&id) {
            // Only a checksum confirms the number of a channel.
            if !(checked && channel.checked) {
                let check = |topic| self.plausibility.check(topic, &message, checked);
                match channel.topic.map_or(Plausibility::Invalid, check) {
                    Plausibility::Valid => {}
                    Plausibility::Repeated if checked => {}
                    Plausibility::Repeated => return Ok(Ok(None)),
                    Plausibility::Invalid => return Ok(Err(format!("a message of {} is invalid", channel.name))),
                }
            }
        }
        let Some(channel) = self.channels.get(&id) else { return Ok(Ok(None)) };
        if checked {
            self.plausibility.observe(channel.topic, &message);
        }
        let MessageRecord { sequence, log_time, publish_time, data, .. } = message;
        if let Some(output) = &mut self.output {
            output.message(&MessageHeader { channel_id: channel.number, sequence, log_time, publish_time }, data)?;
        }
        self.found.count(&channel.name);
        match channel.topic {
            Some(Topic::State) => self.found.states.add(sequence),
            Some(Topic::Command) => self.found.commands.add(sequence),
            _ => {}
        }
        Ok(Ok(Some(sequence)))
    }
}
